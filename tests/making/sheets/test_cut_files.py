"""Cut files hold their layers true to scale, as independent readers find."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from helpers.panels import pattern_of, striped

from toros_fem.making.panels import ManufactureOptions, PanelDrawing, panel_drawings
from toros_fem.making.sheets import write_cut_svg

SVG = "{http://www.w3.org/2000/svg}"


SHEET = 0.45, 0.3


def sheet_of(kind: str) -> list[PanelDrawing]:
    """All panels side by side on a sheet."""
    pattern = pattern_of(kind)
    x, placed = 0.02, []
    for drawing in panel_drawings(pattern, striped(pattern), ManufactureOptions()):
        left, low, right, _ = drawing.footprint.bounds
        placed.append(drawing.moved(0.0, np.array([x - left, 0.02 - low])))
        x += right - left + 5e-3
    assert x < SHEET[0]
    return placed


def path_rings(data: str) -> list[np.ndarray]:
    return [
        np.array([[float(v) for v in pair.split(",")] for pair in ring.strip(" Z").split("L")])
        for ring in data.split("M")[1:]
    ]


def test_a_full_sheet_has_its_ruler_below(tmp_path: Path) -> None:
    drawings = sheet_of("finger")[:1]
    left, low, right, high = drawings[0].footprint.bounds
    size = right - left, high - low
    write_cut_svg(tmp_path / "cut.svg", [drawings[0].moved(0.0, np.array([-left, -low]))], size)
    root = ET.parse(tmp_path / "cut.svg").getroot()
    height = float(root.get("height", "").removesuffix("mm"))
    assert height == pytest.approx(1e3 * size[1] + 9, abs=1e-2)
    ruler = next(g for g in root.iter(f"{SVG}g") if g.get("class") == "sheet")
    points = path_rings(ruler.findall(f"{SVG}path")[0].get("d", ""))[0]
    assert points[:, 1].min() > 1e3 * size[1]
    assert points[:, 1].max() < height
