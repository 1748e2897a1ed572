"""Bladders cover their skin, fit together at the weld, and are open at the tab only."""

import numpy as np
import pytest
import shapely
from helpers.panels import CLOSED, pattern_of
from shapely.geometry import LineString

from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.bladder import bladder_sheets

OPTIONS = ManufactureOptions(weld_allowance=6e-3, connector_width=8e-3, connector_length=20e-3)


def test_an_open_end_needs_no_more_film() -> None:
    sheet = bladder_sheets(pattern_of("open tube"), OPTIONS.updated(connector_width=None)).drawings[
        0
    ]
    assert np.ptp(sheet.outline.bounds[1::2]) == pytest.approx(0.1 + 0.02, rel=1e-6)


@pytest.mark.parametrize("kind", CLOSED)
def test_both_sheets_have_the_tab_at_the_same_place(kind: str) -> None:
    pattern = pattern_of(kind)
    plain = bladder_sheets(pattern, OPTIONS.updated(connector_width=None)).drawings
    sheets = bladder_sheets(pattern, OPTIONS).drawings
    grown = [
        k
        for k, (before, after) in enumerate(zip(plain, sheets, strict=True))
        if after.outline.area > 1.0001 * before.outline.area
    ]
    assert len(grown) == 2
    tabs = [sheets[k] for k in grown]
    for sheet in tabs:
        assert sheet.cut.geom_type == sheet.outline.geom_type == "Polygon"
        assert sheet.cut.is_valid
        lines = shapely.union_all([LineString(s.line) for s in sheet.seams])
        mouth = sheet.outline.boundary.difference(lines.buffer(1e-5))
        # Closed skins are welded all around, but for the end of the tab, at the cut.
        assert mouth.length == pytest.approx(8e-3, rel=0.01)
        assert mouth.distance(sheet.cut.boundary) < 1e-6
        for notch in sheet.notches:
            assert not LineString(notch).intersects(sheet.outline)
    # The weld with the tab comes last. It is longer by both sides of the tab, less its width.
    numbers = {sheet.seams[-1].number for sheet in tabs}
    assert len(numbers) == 1
    for k, sheet in zip(grown, tabs, strict=True):
        lengths = [
            sum(LineString(seam.line).length for seam in one.seams if seam.number in numbers)
            for one in (plain[k], sheet)
        ]
        assert lengths[1] - lengths[0] == pytest.approx(2 * 26e-3 - 8e-3, abs=1.5e-3)


@pytest.mark.parametrize("kind", ["walker", "gripper", "finger", "sphere", "torus"])
def test_other_skins_get_their_panels(kind: str) -> None:
    pattern = pattern_of(kind)
    sheets = bladder_sheets(pattern, OPTIONS.updated(connector_width=None)).drawings
    assert [sheet.name for sheet in sheets] == [f"bladder {name}" for name in pattern.panel_names]
    for panel, sheet in enumerate(sheets):
        assert sheet.outline.equals(pattern.outline(panel))
        assert sheet.outline.distance(sheet.cut.boundary) == pytest.approx(6e-3, rel=2e-3)
        assert len(sheet.crosses) == 0
        assert sheet.grain == ()


def test_the_tab_goes_where_it_is_wanted() -> None:
    pattern = pattern_of("finger")
    top, bottom = bladder_sheets(pattern, OPTIONS, ("top", np.array([0.0, 0.0]))).drawings
    # The finger begins at x = 0, and so do both tabs.
    for sheet in (top, bottom):
        assert sheet.cut.bounds[0] == pytest.approx(-26e-3, abs=1e-4)


def test_a_sheet_has_no_bladder() -> None:
    assert bladder_sheets(pattern_of("sheet")).drawings == []
