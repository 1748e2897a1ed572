"""The flat pattern in the page has the size of the drawing."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

from toros_fem.results.report.flat_pattern import flat_pattern


def test_it_is_the_drawing_with_a_bar(run: Path) -> None:
    text = flat_pattern(run / "pattern.svg")
    before, after = ET.parse(run / "pattern.svg").getroot(), ET.fromstring(text)
    assert after.get("width") == before.get("width")
    drawn = [part.get("d") for part in before.iter() if part.get("class") == "print"]
    assert [part.get("d") for part in after.iter("path") if part.get("class") == "print"] == drawn
    for group in after.iter("g"):
        if group.get("class") != "bar":
            kinds = [part.get("class") for part in group.iter("path")]
            assert kinds == ["cut", "print"], "the print is not covered"
    bar = re.search(r"M5,[\d.]+ v2 h(\d+) v-2", text)
    assert bar
    assert bar[1] == "10"
    assert "10 mm" in text
    assert not [part for part in after.iter() if part.get("id")], "the page has its own"


def test_without_a_drawing_there_is_nothing(tmp_path: Path) -> None:
    assert flat_pattern(tmp_path / "pattern.svg") == ""
    (tmp_path / "pattern.svg").write_text("<svg", encoding="utf-8")
    assert flat_pattern(tmp_path / "pattern.svg") == ""
