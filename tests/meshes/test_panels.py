"""Panels beside each other do not overlap; triangles and regions cut by each other."""

import numpy as np
import pytest
import shapely
from helpers import surfaces
from mpi4py import MPI

from toros_fem.meshes import Pattern, cylinder, rectangle, two_panels, unwrap
from toros_fem.meshes.panels import arranged, cut_by_triangles, panel_places

SQUARE = 0.02 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def offsets(pattern: Pattern, gap: float) -> list[np.ndarray]:
    """Translations of panels on a drawing without a page, where none is turned."""
    places = panel_places(pattern, gap)
    assert not any(place.angle for place in places)
    return [place.offset for place in places]


def boxes(pattern: Pattern, moves: list[np.ndarray]) -> np.ndarray:
    """Corners of each panel's bounding box on the drawing, (p, 2 corners, 2)."""
    placed = [
        pattern.corners[pattern.panel == k].reshape(-1, 2) + move for k, move in enumerate(moves)
    ]
    return np.array([[points.min(axis=0), points.max(axis=0)] for points in placed])


def least_gap(found: np.ndarray) -> float:
    """Smallest gap between two boxes; negative where two overlap."""
    low, high = found[:, 0], found[:, 1]
    gaps = np.maximum(low[:, None] - high, low - high[:, None]).max(axis=2)
    return float(gaps[np.triu_indices(len(low), 1)].min())


def test_arranged_panels_are_upright_and_apart() -> None:
    """Rectangles of several sizes and directions: congruent, long sides along y, no overlap."""
    rng = np.random.default_rng(0)
    panels = []
    for size in rng.uniform(0.01, 0.05, (7, 2)):
        angle = rng.uniform(0, 2 * np.pi)
        c, s = np.cos(angle), np.sin(angle)
        panels.append(SQUARE / 0.02 * size @ np.array([[c, s], [-s, c]]) + rng.normal(size=2))
    placed = arranged(panels)
    for before, after in zip(panels, placed, strict=True):
        one, two = (np.linalg.norm(p[:, None] - p, axis=2) for p in (before, after))
        assert two == pytest.approx(one, abs=1e-15)
        width, height = np.ptp(after, axis=0)
        assert width * height == pytest.approx(one[0, 1] * one[1, 2], rel=1e-12)
        assert width <= height
    found = np.array([[points.min(axis=0), points.max(axis=0)] for points in placed])
    side = np.sqrt(np.prod(found[:, 1] - found[:, 0], axis=1).sum())
    assert least_gap(found) == pytest.approx(0.04 * side)
    assert found.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-15)


@pytest.mark.parametrize("kind", ["tube", "two panels", "touching"])
def test_panels_that_overlap_or_touch_are_packed(alone: MPI.Comm, kind: str) -> None:
    if kind == "tube":
        pattern = cylinder(alone, 0.06, 0.02, 5e-3, mesh="structured")
    else:  # the bottom is (x, −y): it touches the top along y = 0 if the outline begins there
        pattern = two_panels(alone, SQUARE - (0 if kind == "touching" else 0.01), 5e-3)
    found = boxes(pattern, offsets(pattern, 7e-3))
    assert least_gap(found) == pytest.approx(7e-3)
    assert found.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-15)


def test_panels_that_are_apart_keep_their_places(alone: MPI.Comm) -> None:
    pattern = unwrap(alone, surfaces.welded_box(2)).pattern
    assert len(pattern.panel_names) == 6
    same = offsets(pattern, 0.1)
    assert np.ptp(same, axis=0) == pytest.approx([0, 0], abs=0)
    found = boxes(pattern, same)
    assert least_gap(found) > 1e-3
    assert found.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-15)
    places = panel_places(pattern, 0.1, (1, 1))
    assert np.ptp([place.offset for place in places], axis=0) == pytest.approx([0, 0], abs=0)
    one = rectangle(alone, 0.02, 0.01, 5e-3)
    assert np.array(offsets(one, 0.1)) == pytest.approx(-one.flat_points.min(axis=0)[None], abs=0)


@pytest.mark.parametrize(
    ("page", "turned", "size"),
    # The wall lies, with both ends above each other beside it; or it stands, with both below it.
    [((13, 6.5), True, (0.15 + 0.015 + 0.02, 0.0628)), ((4, 9), False, (0.0628, 0.185))],
)
def test_slim_panels_fill_a_page(
    alone: MPI.Comm, page: tuple[float, float], turned: bool, size: tuple[float, float]
) -> None:
    pattern = cylinder(alone, 0.15, 0.02, 5e-3, mesh="structured")
    places = panel_places(pattern, 0.015, page)
    placed = [
        place.points(pattern.corners[pattern.panel == k].reshape(-1, 2))
        for k, place in enumerate(places)
    ]
    found = np.array([[points.min(axis=0), points.max(axis=0)] for points in placed])
    assert [place.angle != 0 for place in places] == [turned] * 3
    assert least_gap(found) >= 0.015 - 1e-12
    assert found.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-12)
    assert found.max(axis=(0, 1)) == pytest.approx(size, rel=0.02)


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


def test_parts_keep_the_area_and_lie_in_their_triangles(
    pattern: Pattern, regions: list[shapely.Geometry]
) -> None:
    for panel, region in enumerate(regions):
        corners = pattern.corners[pattern.panel == panel]
        cell, parts = cut_by_triangles(region, corners)
        assert shapely.area(parts).sum() == pytest.approx(region.area, rel=1e-6)
        beyond = shapely.difference(parts, shapely.polygons(corners[cell]))
        assert shapely.area(beyond).sum() < 1e-9 * pattern.areas.sum()


def test_nothing_to_cut(pattern: Pattern) -> None:
    cell, parts = cut_by_triangles(shapely.Polygon(), pattern.corners)
    assert len(cell) == len(parts) == 0
