"""Panels: maps, places, regions, points that move."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from helpers import surfaces
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.meshes import Pattern, cylinder, rectangle, two_panels, unwrap
from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.panels import (
    Affine,
    arranged,
    border_motion,
    cut_by_triangles,
    panel_places,
    with_flat_points,
)

POINTS = np.random.default_rng(0).uniform(-1, 1, (7, 2))
SLANTED = Affine(np.array([[2.0, 0.5], [-0.3, 1.2]]), np.array([0.1, 0.2]))
MAPS = [Affine.shift([0.3, -1]), Affine.turn(0.7, [0.1, 0.2]), Affine.mirror(), SLANTED]
SQUARE = 0.02 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
SIZE = 0.02
LARGEST = 1e-4


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


def along(pattern: Pattern, regions: list) -> tuple[Pattern, np.ndarray]:
    """The pattern on the borders of regions, and which of its triangles are printed."""
    finer, printed = bordered(MPI.COMM_SELF, pattern, regions)
    return finer.pattern, printed


def printed_area(pattern: Pattern, printed: np.ndarray) -> float:
    return float(pattern.areas[printed].sum())


def area_rate(pattern: Pattern, printed: np.ndarray) -> float:
    motion = border_motion(pattern, printed, LARGEST)
    ends = [
        printed_area(with_flat_points(pattern, pattern.flat_points + way * motion), printed)
        for way in (-LARGEST, LARGEST)
    ]
    return (ends[1] - ends[0]) / (2 * LARGEST)


def test_straight_lines_grow_by_length_times_way() -> None:
    """A slanted line across the panel: both ends slide along the panel's border."""
    line = shapely.Polygon([(4e-3, 0), (7e-3, 0), (13e-3, SIZE), (10e-3, SIZE)])
    pattern, printed = along(square(n=20, size=SIZE), [line])
    perimeter = 2 * np.hypot(6e-3, SIZE)
    assert area_rate(pattern, printed) == pytest.approx(perimeter, rel=2e-3)
    motion = border_motion(pattern, printed, LARGEST)
    edge = np.isin(pattern.flat_points[:, 1], (0.0, SIZE))
    assert np.abs(motion[edge, 0]).max() > 1, "they slide further than the border goes"
    assert np.all(motion[edge, 1] == 0), "and stay on it"


@pytest.mark.parametrize("count", [20, 40])
def test_discs_and_holes_grow_by_perimeter_times_way(count: int) -> None:
    """To the order of the mesh; a border's chords are shorter than its arcs."""
    ring = shapely.Point(SIZE / 2, SIZE / 2).buffer(7e-3, 64)
    ring = ring.difference(shapely.Point(SIZE / 2, SIZE / 2).buffer(3e-3, 64))
    pattern, printed = along(square(n=count, size=SIZE), [ring])
    found = area_rate(pattern, printed)
    assert found == pytest.approx(ring.length, rel=0.06 * 20 / count)


def test_both_sides_of_a_seam_slide_alike() -> None:
    """A ring around a tube crosses its seam: the tube is still sewn, and round."""
    pattern = cylinder(MPI.COMM_SELF, 0.06, 0.02, 4e-3)
    wall = pattern.panel_index("wall")
    regions = [shapely.Polygon() for _ in pattern.panel_names]
    regions[wall] = shapely.box(-1, 0.0211, 1, 0.0289)
    pattern, printed = along(pattern, regions)
    motion = border_motion(pattern, printed, LARGEST)
    moved = with_flat_points(pattern, pattern.flat_points + LARGEST * motion)
    width = np.ptp(pattern.flat_points[pattern.flat_triangles[pattern.panel == wall], 0])
    assert printed_area(moved, printed) - printed_area(pattern, printed) == pytest.approx(
        2 * LARGEST * width, rel=1e-6
    )
    radius = np.hypot(*moved.points[moved.vertices_of("wall")].T[:2])
    assert radius == pytest.approx(0.01, rel=0.02)


def test_nothing_is_flattened() -> None:
    """Even a way as long as an edge leaves all triangles as they are turned."""
    line = shapely.box(4e-3, 0, 7e-3, SIZE)
    pattern, printed = along(square(n=20, size=SIZE), [line])
    motion = border_motion(pattern, printed, 1.2e-3)
    for sign in (-1, 1):
        moved = with_flat_points(pattern, pattern.flat_points + sign * 1.2e-3 * motion)
        assert moved.areas.min() > 0
    assert np.abs(motion).max() < 1


@pytest.mark.parametrize("value", [False, True])
def test_plain_and_full_panels_do_not_move(value: bool) -> None:
    pattern = square()
    assert not border_motion(pattern, np.full(len(pattern.panel), value), LARGEST).any()
