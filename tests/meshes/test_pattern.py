"""What a pattern knows of itself; its defects are in contracts/inner_refusals.py."""

import pytest
from helpers.scenes import square


def test_areas_and_topology() -> None:
    sheet = square(n=4, size=0.02)
    assert sheet.areas.sum() == pytest.approx(4e-4, rel=1e-14)
    assert sheet.vertex_areas.sum() == pytest.approx(4e-4, rel=1e-14)
    assert len(sheet.free_edges) == 16
    assert len(sheet.seams) == 0
