"""Cut files beside what tests/contracts and tests/golden read of them."""

import re
import xml.etree.ElementTree as ET
from functools import partial

import pytest
from ezdxf.entitydb import EntityDB
from helpers.panels import pattern_of, striped

from toros_fem.making.panels.panel_drawing import panel_drawings
from toros_fem.making.sheets.cut_files import cut_dxf, cut_svg
from toros_fem.making.sheets.layout import Sheet
from toros_fem.meshes.affine import Affine

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def full() -> Sheet:
    pattern = pattern_of("finger")
    drawing = panel_drawings(pattern, striped(pattern))[0]
    left, low, right, high = drawing.footprint.bounds
    return Sheet((right - left, high - low), [drawing.moved(Affine.shift([-left, -low]))])


def test_a_full_sheet_has_its_ruler_below(full: Sheet) -> None:
    size, root = full.size, ET.fromstring(cut_svg(full))
    height = float(root.get("height", "").removesuffix("mm"))
    assert height == pytest.approx(1e3 * size[1] + 9, abs=1e-2)
    ruler = next(g for g in root.iter(f"{SVG}g") if g.get("class") == "sheet")
    heights = re.findall(r",(-?[\d.]+)", ruler.findall(f"{SVG}path")[0].get("d", ""))
    assert all(1e3 * size[1] < float(y) < height for y in heights)
    assert heights


def test_equal_cuts_have_equal_bytes(full: Sheet, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where sets have another order, as in each process."""
    made, kinds = [], EntityDB.dxf_types_in_use
    for turned in (False, True):
        order = partial(sorted, reverse=turned)
        monkeypatch.setattr(EntityDB, "dxf_types_in_use", lambda of, to=order: to(kinds(of)))
        made.append(cut_dxf(full))
    assert made[0] == made[1]
