from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.design.lines.laid_lines import Joint, cleaned, ribbons

WIDTH = 0.6e-3


def ribbon(
    nodes: np.ndarray, radii: float | np.ndarray, joints: Sequence[Joint] = ()
) -> list[BaseGeometry]:
    """Regions of two panels; the line is on the first."""
    points = np.stack([nodes[:-1], nodes[1:]], axis=1)
    radius = np.broadcast_to(radii, len(nodes))
    both, margin = np.stack([radius[:-1], radius[1:]], axis=1), 3 * WIDTH + 1e-3
    return ribbons(np.zeros(len(points), int), points, both, list(joints), margin, 2)


def region_of(nodes: np.ndarray, radii: float | np.ndarray) -> BaseGeometry:
    return ribbon(nodes, radii)[0]


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0])
def test_a_straight_ribbon_is_exactly_as_wide_as_asked(angle: float) -> None:
    """Whatever its direction; its ends are half circles."""
    nodes = np.stack([np.linspace(0, 0.03, 7), np.full(7, 0.002)], axis=1)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    region = shapely.transform(region_of(nodes @ turn.T, 1e-3), lambda points: points @ turn)
    assert region.bounds == pytest.approx((-1e-3, 1e-3, 0.031, 3e-3), abs=1e-12)


def test_a_ribbon_widens_evenly() -> None:
    nodes = np.stack([np.linspace(0, 0.03, 31), np.zeros(31)], axis=1)
    slope = 1 / 30
    region = region_of(nodes, 0.5e-3 + slope * nodes[:, 0])
    for x, radius in ((0.01, 5 / 6 * 1e-3), (0.02, 7 / 6 * 1e-3)):
        cut = region.intersection(shapely.LineString([(x, -1), (x, 1)]))
        assert 2 * radius < cut.length + 1e-12
        assert cut.length < 2 * radius / np.sqrt(1 - slope**2) + 1e-12, "that of round ends"


@pytest.mark.parametrize("beyond", [0.0, 2.9e-3, 10e-3])
def test_a_ribbon_runs_on_across_a_joint(beyond: float) -> None:
    """Its part near the joint comes with the joint's motion, a quarter turn; no other does."""
    turn, shift = np.array([[0.0, -1.0], [1.0, 0.0]]), np.array([0.1, 0.2])
    edge = np.array([[[0.03, -0.01], [0.03, 0.01]]])
    joint = Joint(1, 0, edge, turn[None], shift[None])
    x = 0.03 + beyond + np.linspace(0, 0.02, 3)
    nodes = np.stack([x, np.full(3, 0.002)], axis=1)
    found = ribbon(nodes, 1e-3, [joint])[1]
    if beyond > 3 * WIDTH + 1e-3:
        assert found.is_empty
        return
    expected = region_of(nodes[:2] @ turn.T + shift, 1e-3)
    assert found.symmetric_difference(expected).area < 1e-12
    assert ribbon(nodes, 1e-3, [Joint(0, 0, edge, turn[None], shift[None])])[1].is_empty


def test_a_sharp_turn_is_round() -> None:
    nodes = np.array([[0, 0], [0.02, 0], [0.02, 0.001], [0, 0.001]])
    region = region_of(nodes, 1e-3)
    line = shapely.LineString(nodes).buffer(1e-3, quad_segs=32)
    assert region.symmetric_difference(line).area < 0.004 * line.area  # 0.0036 seen


def test_no_line_and_no_gap_is_left_that_is_too_thin() -> None:
    def bar(x: float, width: float) -> shapely.Polygon:
        return shapely.box(x, 0, x + width, 0.02)

    thin, near = bar(0.0, 0.9 * WIDTH), bar(0.01 + 1.9 * WIDTH, 2 * WIDTH)
    wide = bar(0.01, 1.1 * WIDTH)
    region = cleaned(shapely.union_all([thin, wide, near]), WIDTH, 0.5e-6)
    assert len(shapely.get_parts(region)) == 1, "the thin one is gone, the others are one"
    assert region.area == pytest.approx(0.02 * 3.9 * WIDTH, rel=1e-2)
    assert cleaned(bar(0.0, 1.01 * WIDTH), WIDTH, 0.5e-6).is_empty
    assert not cleaned(bar(0.0, 1.02 * WIDTH), WIDTH, 0.5e-6).is_empty
    ring = shapely.Point(0, 0).buffer(3e-3).difference(shapely.Point(0, 0).buffer(0.39e-3))
    assert len(cleaned(ring, WIDTH, 0.5e-6).interiors) == 0
    assert len(cleaned(ring, WIDTH, 0.4e-6).interiors) == 1
    assert cleaned(shapely.Point(0, 0).buffer(0.35e-3), WIDTH, 0.5e-6).is_empty
