"""The page: every sheet, every seam, the five steps, and nothing from elsewhere."""

import re
import sys
from pathlib import Path

import pytest
from helpers.browser import opened
from helpers.runs import SUMMARY, regions_of, tube

from toros_fem.base.errors import MissingPackageError
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.sheets.write import write_manufacture


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, pattern = tmp_path_factory.mktemp("page"), tube()
    options = ManufactureOptions(bed_width=0.1, bed_depth=0.19)
    regions = regions_of(pattern)
    write_manufacture(folder, pattern, regions, options, summary=SUMMARY, title="a <b> & c")
    return folder / "make_it.html"


def test_page_needs_no_other_file(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "a &lt;b&gt; &amp; c" in text
    for link in re.findall(r'(?:href|src)="([^"]+)"', text):
        assert link == "data:," or (page.parent / link).is_file()
    assert "@import" not in text
    assert "url(" not in text
    assert "{" not in text.partition("<body>")[2], "all places are filled"


def test_five_steps_say_which_edge_belongs_to_which(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    steps = re.findall(r"<h2>(\d)\. ([^<]+)</h2>", text)
    assert [number for number, _ in steps] == list("12345")
    rows = re.findall(r"<tr><td><i[^>]*>(\d)</i></td>\s*<td>([^<]+)</td>", text)
    assert rows == [("1", "wall to itself"), ("2", "wall to base"), ("3", "wall to tip")]
    assert "Inflate it slowly to 5 kPa" in text
    assert "<b>Hold</b> the fabric" in text
    assert "210 to 230 °C at the nozzle" in text
    assert "The files are not raised" in " ".join(text.split())
    assert "Weld a bladder of film" in text
    assert "No bladder goes in" not in text
    pictures = re.findall(
        r'aria-label="seams on sheet (\d)".*?<figcaption>sheet (\d)<', text, re.DOTALL
    )
    assert pictures == [("1", "1"), ("2", "2")]
    assert "angle 88.2 ± 1.5° of 90° there" in text


@pytest.mark.parametrize(
    ("inputs", "options", "height", "known"),
    [
        ({"thickness": 0.5e-3, "reinforcement_thickness": 0.509603e-3}, None, "0.51", False),
        ({"reinforcement_thickness": 0.509603e-3, "print_height": 0.5e-3}, None, "0.5", True),
        ({"thickness": 0.5e-3}, ManufactureOptions(layer_height=0.3e-3), "0.3", True),
        ({}, None, "0.4", True),
    ],
)
def test_the_height_to_print_is_that_of_the_printed_layer(
    inputs: dict[str, float],
    options: ManufactureOptions | None,
    height: str,
    known: bool,
    tmp_path: Path,
) -> None:
    """The equivalent sheet of fabric and print has another thickness, which nobody prints."""
    pattern = tube(9e-3)
    write_manufacture(tmp_path, pattern, regions_of(pattern), options, summary={"inputs": inputs})
    text = (tmp_path / "make_it.html").read_text(encoding="utf-8")
    assert f"cm², {height} mm high:" in text
    assert ("The material does not say how high its print is" in text) != known


def test_without_jinja2_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(MissingPackageError, match=r"jinja2.*'\.\[manufacture\]'"):
        write_manufacture(tmp_path, tube(9e-3), regions_of(tube(9e-3)))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_page_in_a_browser(page: Path) -> None:
    for width in (1280, 420):
        with opened(page, width=width, height=900) as shown:
            assert not shown.complaints
            assert all(url.startswith(("file:", "data:")) for url in shown.requests)
            assert shown.run("return document.documentElement.scrollWidth <= window.innerWidth")
            boxes = shown.run(
                "return [...document.querySelectorAll('figure svg')].map(s => {"
                "const b = s.getBoundingClientRect(); return [b.width, b.height] })"
            )
            # Two beds, two sheets, and their seams.
            assert len(boxes) == 6
            assert all(w > 200 and h > 60 for w, h in boxes)
