"""Triangles and regions cut by each other: nothing is lost, and every corner is at its place."""

import numpy as np
import pytest
import shapely
from mpi4py import MPI

from toros_fem.meshes import Pattern, cylinder
from toros_fem.meshes.cut_triangles import CutTriangles, cut_by_triangles, cut_triangles


@pytest.fixture(scope="module")
def pattern(alone: MPI.Comm) -> Pattern:
    return cylinder(alone, 0.04, 0.02, 4e-3)


@pytest.fixture(scope="module")
def regions(pattern: Pattern) -> list[shapely.Geometry]:
    """A wavy line on the wall, and the base with a hole inside one triangle."""
    s = np.linspace(-0.01, 0.08, 300)
    line = shapely.LineString(np.stack([s, 0.02 + 4e-3 * np.sin(300 * s)], axis=1)).buffer(3e-3)
    hole = shapely.Point(pattern.centroids[pattern.cells_of("base")[0]]).buffer(2e-4, quad_segs=2)
    shapes = {"wall": line, "base": shapely.box(-1, -1, 1, 1) - hole, "tip": shapely.Polygon()}
    outlines = [
        shapely.union_all(shapely.polygons(pattern.corners[pattern.panel == panel]))
        for panel in range(3)
    ]
    names = pattern.panel_names
    return [o & shapes[name] for o, name in zip(outlines, names, strict=True)]


@pytest.fixture(scope="module")
def cut(pattern: Pattern, regions: list[shapely.Geometry]) -> CutTriangles:
    return cut_triangles(pattern, regions)


def test_print_keeps_its_area(
    pattern: Pattern, regions: list[shapely.Geometry], cut: CutTriangles
) -> None:
    area = sum(region.area for region in regions)
    assert cut.areas[cut.inside].sum() == pytest.approx(area, rel=1e-6)
    reached = np.unique(cut.cell)
    by_triangle = np.bincount(cut.cell, cut.areas, minlength=len(pattern.panel))
    assert by_triangle[reached] == pytest.approx(pattern.areas[reached], rel=1e-5)
    base = pattern.panel[cut.cell] == pattern.panel_index("base")
    assert np.array_equal(cut.cell[base & ~cut.inside], pattern.cells_of("base")[:1])
    assert not np.any(pattern.panel[cut.cell] == pattern.panel_index("tip"))


def test_corners_are_where_the_rings_are(pattern: Pattern, cut: CutTriangles) -> None:
    """Areas by the corners of all rings, holes counted negative, are those of the polygons."""
    points = cut.corners(pattern.corners)
    found = np.zeros(len(cut.cell))
    for ring, polygon in enumerate(cut.polygon):
        x, y = points[cut.first[ring] : cut.first[ring + 1]].T
        assert (x[0], y[0]) == pytest.approx((x[-1], y[-1]), abs=1e-15)
        found[polygon] += (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() / 2
    assert np.abs(found) == pytest.approx(cut.areas, rel=1e-6, abs=1e-15)
    assert len(cut.polygon) > len(cut.cell), "one has a hole"
    assert cut.weights.min() > -1e-9


def test_copies_are_on_their_own_triangles(pattern: Pattern, cut: CutTriangles) -> None:
    count = len(pattern.panel)
    twice = cut.repeated(2, count)
    corners = np.concatenate([pattern.corners, pattern.corners + 1.0])
    one, two = np.split(twice.corners(corners), 2)
    assert two == pytest.approx(one + 1.0, abs=1e-12)
    assert np.array_equal(twice.cell, np.append(cut.cell, cut.cell + count))
    assert twice.first[-1] == len(twice.weights) == 2 * len(cut.weights)


def test_nothing_to_cut(pattern: Pattern) -> None:
    cell, parts = cut_by_triangles(shapely.Polygon(), pattern.corners)
    assert len(cell) == len(parts) == 0
    empty = cut_triangles(pattern, [shapely.Polygon()] * 3)
    assert len(empty.cell) == len(empty.weights) == 0
    assert empty.corners(pattern.corners).shape == (0, 2)
