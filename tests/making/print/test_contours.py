"""Contours are exact, and valid polygons whatever the values."""

import math

import numpy as np
import pytest
from helpers.prints import regions_of
from helpers.scenes import square
from mpi4py import MPI
from shapely.geometry import Point, Polygon, box

from toros_fem.making.print.contours import printed_regions
from toros_fem.meshes import cylinder


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8), (1.0, -1.0)])
@pytest.mark.parametrize("fraction", [0.3, 0.5, 1 / 3, 0.83])
def test_half_planes_are_exact(direction: tuple[float, float], fraction: float) -> None:
    pattern = square()
    normal = np.array(direction) / math.hypot(*direction)
    heights = pattern.flat_points @ normal
    level = heights.min() + fraction * np.ptp(heights)
    (region,) = regions_of(pattern, lambda points: 0.5 + 10 * (points @ normal - level))
    assert region.is_valid
    half = Polygon([level * normal + sign * 0.1 * np.array([-normal[1], normal[0]]) + far * normal
                    for sign, far in ((-1, 0), (1, 0), (1, 0.1), (-1, 0.1))])  # fmt: skip
    exact = half.intersection(box(0, 0, 0.02, 0.02)).area
    assert region.area == pytest.approx(exact, rel=1e-12)


def test_both_given_values_are_met() -> None:
    """A lone printed centroid makes a triangle, a lone printed vertex a star."""
    pattern = square(n=4)
    points, centroids = np.zeros(25), np.zeros(32)
    centroids[9] = 1.0
    (region,) = printed_regions(pattern, points, centroids, 0.5)
    assert region.area == pytest.approx(pattern.areas[9] / 4)
    points, centroids = np.zeros(25), np.zeros(32)
    points[12] = 1.0
    (region,) = printed_regions(pattern, points, centroids, 0.5)
    # Half as far along all edges of the six triangles' thirds around it.
    assert region.area == pytest.approx(6 * pattern.areas[0] * 2 / 3 / 4)
    assert region.contains(Point(pattern.flat_points[12]))


def test_whole_and_empty_panels(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.04, 0.02, 4e-3)
    ones = np.ones(len(pattern.flat_points)), np.ones(len(pattern.panel))
    for panel, region in enumerate(printed_regions(pattern, *ones, 0.5)):
        outline = pattern.outline(panel)
        assert region.normalize().equals_exact(outline.normalize(), 0)
        assert region.area == pytest.approx(pattern.areas[pattern.panel == panel].sum(), rel=1e-13)
    assert all(r.is_empty for r in printed_regions(pattern, 0 * ones[0], 0 * ones[1], 0.5))
    assert all(r.is_empty for r in printed_regions(pattern, *ones, 1.0)), "above, not at"


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_values_at_the_threshold(seed: int) -> None:
    """Values exactly at or next to the threshold leave valid polygons of the right area."""
    pattern = square(n=20)
    rng = np.random.default_rng(seed)
    values = [0.0, 0.5, 0.5 + 1e-16, 0.5 - 1e-12, 0.5 + 1e-8, 1.0]
    points, centroids = rng.choice(values, 441), rng.choice(values, 800)
    (region,) = printed_regions(pattern, points, centroids, 0.5)
    assert region.is_valid
    (below,) = printed_regions(pattern, 1 - points, 1 - centroids, 0.5)
    assert below.is_valid
    assert region.intersection(below).area < 1e-9 * region.area
    # A triangle is three around its centroid, each with a linear field.
    points, centroids = (np.where(np.abs(v - 0.5) < 1e-9, 0, v - 0.5) for v in (points, centroids))
    corners = points[pattern.flat_triangles]
    sides = [np.stack([corners[:, k], corners[:, k - 1], centroids], 1) for k in range(3)]
    low, middle, high = np.sort(np.concatenate(sides), axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        one = high**2 / ((high - low) * (high - middle))  # only the highest corner is above
        two = 1 - low**2 / ((high - low) * (middle - low))
    part = np.where(low >= 0, high > 0, np.where(middle > 0, two, np.where(high > 0, one, 0)))
    expected = np.tile(pattern.areas / 3, 3) @ part
    assert region.area == pytest.approx(expected, rel=1e-9)
