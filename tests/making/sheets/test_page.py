"""The page: every sheet, every seam, the five steps, and nothing from elsewhere."""

import re
from pathlib import Path

import pytest
from helpers.browser import opened
from helpers.runs import SUMMARY, regions_of, tube

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
    assert "$" not in text, "all places are filled"


def test_five_steps_say_which_edge_belongs_to_which(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    steps = re.findall(r"<h2>(\d)\. ([^<]+)</h2>", text)
    assert [number for number, _ in steps] == list("12345")
    rows = re.findall(r"<tr><td>(\d)</td><td><i[^>]*>(\d)</i></td><td>([^<]+)</td>", text)
    assert rows == [
        ("1", "1", "wall to itself"),
        ("2", "3", "wall to tip"),
        ("3", "2", "wall to base"),
    ]
    assert "Inflate it slowly to 5 kPa" in text
    assert "Cut the sheets of film" in text
    assert "No bladder goes in" not in text
    pictures = re.findall(r'aria-label="seams on sheet (\d)".*?<figcaption>sheet (\d)<', text)
    assert pictures == [("1", "1"), ("2", "2")]
    assert "angle 88.25° there" in text


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
            # Two beds, two sheets, their seams, and the bladder.
            assert len(boxes) == 7
            assert all(w > 200 and h > 60 for w, h in boxes)
