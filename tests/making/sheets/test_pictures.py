"""Pictures of sheets and seams have everything at its place, in mm, with y down."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np
import pytest
from helpers.panels import pattern_of, striped

from toros_fem.making.panels import ManufactureOptions, PanelDrawing, panel_drawings
from toros_fem.making.sheets.pictures import CAPITAL, seam_picture, sheet_picture

SIZE = (0.3, 0.2)


@pytest.fixture(scope="module")
def drawing() -> PanelDrawing:
    pattern = pattern_of("tube")
    wall = panel_drawings(pattern, striped(pattern), ManufactureOptions())[0]
    return wall.moved(0.0, np.array([0.05, 0.05]) - wall.footprint.bounds[:2])


def lines(svg: ET.Element) -> Iterator[tuple[str | None, np.ndarray]]:
    """Style and points in m, with y up, of each line."""
    for line in svg.iter("polyline"):
        pairs = [pair.split(",") for pair in line.get("points", "").split()]
        yield line.get("style"), np.array(pairs, dtype=float) * [1e-3, -1e-3] + [0, SIZE[1]]


def test_texts_stand_around_their_places(drawing: PanelDrawing) -> None:
    """The middle of the capitals is the place of the label, whichever way it is turned."""
    found = []
    for text in ET.fromstring(sheet_picture([drawing], SIZE, "")).iter("text"):
        words = text.get("transform", "").replace("(", " ").replace(")", " ").split()
        x, y, degrees = float(words[1]), float(words[2]), float(words[4])
        half, angle = CAPITAL * float(text.get("font-size", "")) / 2, np.radians(degrees)
        middle = 1e-3 * np.array([x + half * np.sin(angle), y - half * np.cos(angle)])
        found.append((text.text, *(middle * [1, -1] + [0, SIZE[1]])))
    for label in drawing.labels:
        assert any(
            text == label.text and np.hypot(*(label.place - at)) < 2e-5 for text, *at in found
        ), label.text


def test_seams_have_their_colours_and_places(drawing: PanelDrawing) -> None:
    """A line and its disc have one colour; no two seams have the same."""
    svg = ET.fromstring(seam_picture([drawing], SIZE, ""))
    drawn = list(lines(svg))
    colours = [(style or "").removeprefix("stroke:") for style, _ in drawn]
    discs = [(disc.get("style") or "").removeprefix("fill:") for disc in svg.iter("circle")]
    assert colours == discs
    numbers = [seam.number for seam in drawing.seams]
    assert len(set(colours)) == len(set(numbers)) > 1
    for seam, (_, points) in zip(drawing.seams, drawn, strict=True):
        assert points == pytest.approx(np.asarray(seam.line), abs=1e-5)
