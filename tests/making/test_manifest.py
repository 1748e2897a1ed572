"""The page that shows how to make a design."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import opened
from helpers.panels import pattern_of, striped
from helpers.runs import SUMMARY, regions_of, tube

from toros_fem.base.errors import MissingPackageError
from toros_fem.making.layout import CutSheet
from toros_fem.making.machine_files import write_manufacture
from toros_fem.making.manifest import seam_picture, sheet_picture
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panel_drawing import CAPITAL, PanelDrawing, panel_drawings
from toros_fem.meshes.panels import Affine

SIZE = (0.3, 0.2)
SVG = "{http://www.w3.org/2000/svg}"


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


def upright(points: np.ndarray) -> np.ndarray:
    """Points in m with y up, from mm with y down."""
    return points * [1e-3, -1e-3] + [0.0, SIZE[1]]


@pytest.fixture(scope="module")
def drawing() -> PanelDrawing:
    pattern = pattern_of("tube")
    wall = panel_drawings(pattern, striped(pattern), ManufactureOptions())[0]
    return wall.moved(Affine.shift(np.array([0.05, 0.05]) - wall.footprint.bounds[:2]))


def test_texts_stand_around_their_places(drawing: PanelDrawing) -> None:
    """The middle of the capitals is the place of the label, whichever way it is turned."""
    found = []
    for text in ET.fromstring(sheet_picture(CutSheet(SIZE, [drawing]), "a sheet")).iter(
        f"{SVG}text"
    ):
        x, y, degrees = map(float, re.findall(r"-?[\d.]+", text.get("transform", "")))
        half, angle = CAPITAL * float(text.get("font-size", "")) / 2, np.radians(degrees)
        middle = np.array([x + half * np.sin(angle), y - half * np.cos(angle)])
        found.append((text.text, upright(middle)))
    for label in drawing.labels:
        off = [np.linalg.norm(at - label.place) for text, at in found if text == label.text]
        assert min(off) < 2e-5


def test_a_ruler_below_a_full_sheet_is_seen(drawing: PanelDrawing) -> None:
    left, low, right, high = drawing.footprint.bounds
    full, size = drawing.moved(Affine.shift([-left, -low])), (right - left, high - low)
    svg = ET.fromstring(sheet_picture(CutSheet(size, [full]), "a sheet"))
    _, top, _, deep = map(float, svg.get("viewBox", "").split())
    lines = [line.get("d", "") for line in svg.iter(f"{SVG}path")]
    y = [float(text) for line in lines for text in re.findall(r",(-?[\d.]+)", line)]
    assert max(y) > 1e3 * size[1]
    assert top <= min(y)
    assert max(y) <= top + deep


def test_seams_have_their_colours_and_places(drawing: PanelDrawing) -> None:
    """A line and its disc have one colour; no two seams have the same."""
    svg = ET.fromstring(seam_picture(CutSheet(SIZE, [drawing]), "seams"))
    lines = svg.findall(f"{SVG}g[@class='sewn']/{SVG}path")
    discs = list(svg.iter(f"{SVG}circle"))
    colours = [line.get("style", "").removeprefix("stroke:") for line in lines]
    assert colours == [disc.get("style", "").removeprefix("fill:") for disc in discs]
    assert len(set(colours)) == len({seam.number for seam in drawing.seams}) > 1
    for seam, line in zip(drawing.seams, lines, strict=True):
        numbers = list(map(float, re.findall(r"-?[\d.]+", line.get("d", ""))))
        assert upright(np.reshape(numbers, (-1, 2))) == pytest.approx(seam.line, abs=1e-5)
