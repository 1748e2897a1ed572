"""Cut files beside what tests/contracts and tests/golden read of them."""

import io
import re
import xml.etree.ElementTree as ET
from functools import partial

import ezdxf
import numpy as np
import pytest
from ezdxf import bbox
from ezdxf.entitydb import EntityDB
from helpers.panels import pattern_of, striped

from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.marks import Label
from toros_fem.making.panels.panel_drawing import panel_drawings
from toros_fem.making.sheets.layout import CutSheet
from toros_fem.making.sheets.write import cut_dxf, cut_svg, outlines
from toros_fem.meshes.panels import Affine

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def full() -> CutSheet:
    pattern = pattern_of("finger")
    drawing = panel_drawings(pattern, striped(pattern))[0]
    left, low, right, high = drawing.footprint.bounds
    return CutSheet((right - left, high - low), [drawing.moved(Affine.shift([-left, -low]))])


def test_a_full_sheet_has_its_ruler_below(full: CutSheet) -> None:
    size, root = full.size, ET.fromstring(cut_svg(full))
    height = float(root.get("height", "").removesuffix("mm"))
    assert height == pytest.approx(1e3 * size[1] + 9, abs=1e-2)
    ruler = next(g for g in root.iter(f"{SVG}g") if g.get("class") == "sheet")
    heights = re.findall(r",(-?[\d.]+)", ruler.findall(f"{SVG}path")[0].get("d", ""))
    assert all(1e3 * size[1] < float(y) < height for y in heights)
    assert heights


def test_equal_cuts_have_equal_bytes(full: CutSheet, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where sets have another order, as in each process."""
    made, kinds = [], EntityDB.dxf_types_in_use
    for turned in (False, True):
        order = partial(sorted, reverse=turned)
        monkeypatch.setattr(EntityDB, "dxf_types_in_use", lambda of, to=order: to(kinds(of)))
        made.append(cut_dxf(full))
    assert made[0] == made[1]


@pytest.mark.parametrize("version", ["R12", "R2010"])
@pytest.mark.parametrize("letters", ["text", "outlines"])
def test_versions_letters_and_extents_of_dxf(full: CutSheet, version: str, letters: str) -> None:
    """R12 knows no light polylines; the extents are those of all lines."""
    written = cut_dxf(full, ManufactureOptions(dxf_version=version, letters=letters)).decode()
    document = ezdxf.read(io.StringIO(written))
    assert not document.audit().errors
    kinds = {entity.dxftype() for entity in document.modelspace()}
    lines = "POLYLINE" if version == "R12" else "LWPOLYLINE"
    assert kinds == ({lines, "TEXT"} if letters == "text" else {lines})
    seen = bbox.extents(document.modelspace())
    assert np.allclose(document.header["$EXTMIN"], seen.extmin)
    assert np.allclose(document.header["$EXTMAX"], seen.extmax)
    layers = {entity.dxf.layer for entity in document.modelspace()}
    assert layers == {"print", "seam", "marks", "labels", "cut"}


def test_outlines_in_svg(full: CutSheet) -> None:
    """No text is left, and the lettering is where the text was."""
    root = ET.fromstring(cut_svg(full, ManufactureOptions(letters="outlines")))
    assert not list(root.iter(f"{SVG}text"))
    assert list(ET.fromstring(cut_svg(full)).iter(f"{SVG}text"))


def test_letters_have_the_place_and_height_of_their_label() -> None:
    for turn in (0.0, np.pi / 2):
        (ring, *_) = outlines(Label("H", np.array([0.1, 0.2]), turn, 4e-3))
        wide, high = np.ptp(ring, axis=0)[:: 1 if turn == 0 else -1]
        assert high == pytest.approx(4e-3, rel=5e-3)
        assert 2e-3 < wide < 4e-3
        assert (ring.min(axis=0) + ring.max(axis=0)) / 2 == pytest.approx([0.1, 0.2], abs=5e-5)
