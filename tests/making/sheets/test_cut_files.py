"""Cut files beside what tests/contracts and tests/golden read of them."""

import re
import xml.etree.ElementTree as ET

import pytest
from helpers.panels import pattern_of, striped

from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.panel_drawing import panel_drawings
from toros_fem.making.sheets.cut_files import cut_svg
from toros_fem.making.sheets.layout import Sheet
from toros_fem.meshes.affine import Affine

SVG = "{http://www.w3.org/2000/svg}"


def test_a_full_sheet_has_its_ruler_below() -> None:
    pattern = pattern_of("finger")
    drawing = panel_drawings(pattern, striped(pattern), ManufactureOptions())[0]
    left, low, right, high = drawing.footprint.bounds
    size = right - left, high - low
    root = ET.fromstring(cut_svg(Sheet(size, [drawing.moved(Affine.shift([-left, -low]))])))
    height = float(root.get("height", "").removesuffix("mm"))
    assert height == pytest.approx(1e3 * size[1] + 9, abs=1e-2)
    ruler = next(g for g in root.iter(f"{SVG}g") if g.get("class") == "sheet")
    heights = re.findall(r",(-?[\d.]+)", ruler.findall(f"{SVG}path")[0].get("d", ""))
    assert all(1e3 * size[1] < float(y) < height for y in heights)
    assert heights
