"""Affine maps of points, of regions, of both after each other, and back."""

import numpy as np
import pytest
import shapely

from toros_fem.meshes.affine import Affine

POINTS = np.random.default_rng(0).uniform(-1, 1, (7, 2))
SLANTED = Affine(np.array([[2.0, 0.5], [-0.3, 1.2]]), np.array([0.1, 0.2]))
MAPS = [Affine.shift([0.3, -1]), Affine.turn(0.7, [0.1, 0.2]), Affine.mirror(), SLANTED]


@pytest.mark.parametrize("one", MAPS)
def test_points_and_regions_move_alike(one: Affine) -> None:
    region = shapely.Polygon(POINTS[:3])
    there = shapely.get_coordinates(one.region(region))
    assert there == pytest.approx(one.points(shapely.get_coordinates(region)))
    assert one.vectors(POINTS[1] - POINTS[0]) == pytest.approx(
        np.diff(one.points(POINTS[:2]), axis=0)[0]
    )
    assert one.inverse.points(one.points(POINTS)) == pytest.approx(POINTS)
    assert (one.inverse @ one).matrix == pytest.approx(np.eye(2), abs=1e-15)


def test_the_right_one_comes_first() -> None:
    for one in MAPS:
        for other in MAPS:
            assert (one @ other).points(POINTS) == pytest.approx(one.points(other.points(POINTS)))


def test_turns_are_counter_clockwise_and_quarters_exact() -> None:
    assert Affine.turn(np.pi / 2).points([1.0, 0.0]).tolist() == [0.0, 1.0]
    assert Affine.turn(-3 * np.pi / 2).matrix.tolist() == [[0.0, -1.0], [1.0, 0.0]]
    assert Affine.turn(0.7, [3, 4]).angle == pytest.approx(0.7)
    assert Affine.mirror().points([2.0, 3.0]).tolist() == [-2.0, 3.0]


def test_the_map_between_points_is_found() -> None:
    far = POINTS + 1e3  # a fit about the origin would lose six digits
    found = Affine.fit(far, SLANTED.points(far))
    assert found.matrix == pytest.approx(SLANTED.matrix, abs=1e-11)
    noise = 1e-3 * np.random.default_rng(1).normal(size=POINTS.shape)
    near = Affine.fit(POINTS, SLANTED.points(POINTS) + noise)
    assert np.abs(near.points(POINTS) - SLANTED.points(POINTS) - noise).max() < 3e-3
