import numpy as np
import pytest
import shapely

from toros_fem.design.lines.strips import Joint, Strip, cleaned, ribbons

WIDTH = 0.6e-3


def strip(nodes: np.ndarray, radii: float | np.ndarray, beyond: tuple[bool, bool]) -> Strip:
    points = np.stack([nodes[:-1], nodes[1:]], axis=1)
    radius = np.broadcast_to(radii, len(nodes))
    return Strip(
        np.zeros(len(points), dtype=int), points, np.stack([radius[:-1], radius[1:]], 1), beyond
    )


def test_a_straight_strip_is_exactly_as_wide_as_asked() -> None:
    nodes = np.stack([np.linspace(0, 0.03, 7), np.full(7, 0.002)], axis=1)
    region = shapely.union_all(ribbons([strip(nodes, 1e-3, (False, False))], 0, [], WIDTH))
    x, y, right, top = region.bounds
    assert (y, top) == pytest.approx((1e-3, 3e-3), abs=1e-12)
    assert (x, right) == pytest.approx((-1e-3, 0.031), abs=1e-12)
    longer = shapely.union_all(ribbons([strip(nodes, 1e-3, (False, True))], 0, [], WIDTH))
    assert longer.bounds[0] == pytest.approx(-1e-3, abs=1e-12)
    assert longer.bounds[2] > 0.031 + 3e-3


def test_a_strip_widens_evenly() -> None:
    nodes = np.stack([np.linspace(0, 0.03, 31), np.zeros(31)], axis=1)
    radii = np.linspace(0.5e-3, 1.5e-3, 31)
    region = shapely.union_all(ribbons([strip(nodes, radii, (False, False))], 0, [], WIDTH))
    for x, radius in ((0.01, 5 / 6 * 1e-3), (0.02, 7 / 6 * 1e-3)):
        cut = region.intersection(shapely.LineString([(x, -1), (x, 1)]))
        assert cut.length == pytest.approx(2 * radius, rel=1e-9)


@pytest.mark.parametrize("beyond", [0.0, 2.9e-3, 10e-3])
def test_a_strip_runs_on_across_a_joint(beyond: float) -> None:
    """Its part near the joint comes with the joint's motion, a quarter turn; no other does."""
    turn, shift = np.array([[0.0, -1.0], [1.0, 0.0]]), np.array([0.1, 0.2])
    edge = np.array([[[0.03, -0.01], [0.03, 0.01]]])
    joint = Joint(1, 0, edge, turn[None], shift[None])
    x = 0.03 + beyond + np.linspace(0, 0.02, 3)
    nodes = np.stack([x, np.full(3, 0.002)], axis=1)
    lone = strip(nodes, 1e-3, (False, False))
    found = shapely.union_all(ribbons([lone], 1, [joint], WIDTH))
    if beyond > 3 * WIDTH + 1e-3:
        assert found.is_empty
        return
    there = nodes[:2] @ turn.T + shift
    expected = shapely.union_all(ribbons([strip(there, 1e-3, (False, False))], 0, [], WIDTH))
    assert found.symmetric_difference(expected).area < 1e-12
    assert not ribbons([lone], 1, [Joint(0, 0, edge, turn[None], shift[None])], WIDTH)


def test_a_sharp_turn_is_round() -> None:
    nodes = np.array([[0, 0], [0.02, 0], [0.02, 0.001], [0, 0.001]])
    region = shapely.union_all(ribbons([strip(nodes, 1e-3, (False, False))], 0, [], WIDTH))
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
