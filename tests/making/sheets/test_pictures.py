"""Pictures of sheets and seams have everything at its place, in mm, with y down."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from helpers.panels import pattern_of, striped

from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.panel_drawing import CAPITAL, PanelDrawing, panel_drawings
from toros_fem.making.sheets.layout import CutSheet
from toros_fem.making.sheets.manifest import seam_picture, sheet_picture
from toros_fem.meshes.panels import Affine

SIZE = (0.3, 0.2)
SVG = "{http://www.w3.org/2000/svg}"


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
