"""Contours become smooth curves of the same area; what is at the cut stays."""

import numpy as np
import pytest
import shapely
from helpers.prints import metres
from shapely.geometry import Point, Polygon, box

from toros_fem.making.print.contours import smoothed

PANEL = metres(box(-20, -20, 20, 20))
LENGTH = 0.7e-3


def wave(period: float, height: float) -> Polygon:
    """A band across the panel, in mm, whose upper border is a wave."""
    x = np.linspace(-20, 20, 801)
    return Polygon([*np.column_stack([x, 3 + height * np.sin(2 * np.pi * x / period)]),
                    (20, -3), (-20, -3)])  # fmt: skip


def roughness(shape: shapely.Geometry) -> float:
    """Standard deviation of the upper border's height in mm, away from the ends."""
    x, y = 1e3 * shapely.get_coordinates(shape).T
    return float(np.std(y[(y > 0) & (np.abs(x) < 12)]))


@pytest.mark.parametrize(("period", "kept"), [(1.0, 0.0), (16.0, 1.0)])
def test_short_waves_vanish_and_long_ones_stay(period: float, kept: float) -> None:
    before = metres(wave(period, 0.1))
    after = smoothed(before, PANEL, LENGTH)
    assert roughness(after) == pytest.approx(kept * roughness(before), abs=5e-3)
    assert after.area == pytest.approx(before.area, rel=1e-3)
    assert after.is_valid


def test_ends_at_the_cut_stay() -> None:
    before = metres(wave(1.0, 0.3))
    after = smoothed(before, PANEL, LENGTH)
    for side in (-0.02, 0.02):
        edge = shapely.LineString([(side, -0.02), (side, 0.02)])
        ends = [shape.intersection(edge).bounds for shape in (before, after)]
        assert ends[1] == pytest.approx(ends[0], abs=1e-9)


def test_discs_keep_their_radius_and_holes_stay_holes() -> None:
    ring = metres(Point(0, 0).buffer(6, 16) - Point(0, 0).buffer(2.5, 8))
    after = smoothed(ring, PANEL, LENGTH)
    assert len(after.interiors) == 1
    assert after.area == pytest.approx(ring.area, rel=0.01)
    corners = metres(box(-3, -3, 3, 3))
    rounder = smoothed(corners, PANEL, LENGTH)
    assert rounder.hausdorff_distance(corners) < LENGTH
    assert rounder.area == pytest.approx(corners.area, rel=0.01)


def test_small_pieces_and_the_panel_stay() -> None:
    dot = metres(Point(3, 2).buffer(0.5, 8))
    assert smoothed(dot, PANEL, LENGTH).equals(dot)
    assert smoothed(PANEL, PANEL, LENGTH).equals(PANEL)
