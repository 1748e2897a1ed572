"""Vertices move onto the borders of polygons, and with the borders of a print."""

import numpy as np
import pytest
import shapely
from helpers.scenes import square
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.making.print.printability import printed_cells
from toros_fem.meshes import Pattern, cylinder, mirrored, two_panels
from toros_fem.meshes.following import LEAST_ANGLE, border_motion, snapped, with_flat_points
from toros_fem.meshes.triangles import corner_angles

NOTHING = shapely.Polygon()
RADIUS = 0.01


def helices(pattern: Pattern, around: float) -> list[BaseGeometry]:
    """Eight lines of 1.6 mm on a tube's wall, at 40° to the axis."""
    corners = pattern.corners[pattern.cells_of("wall")]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    rise = np.array([np.tan(np.radians(40)) * 0.06, 0.06])
    starts = [np.array([k * around / 8, 0.0]) for k in range(-8, 16)]
    lines = [shapely.LineString([s - rise, s + 2 * rise]).buffer(0.8e-3) for s in starts]
    wall = shapely.union_all(lines).intersection(shapely.box(*low, *high))
    return [wall if name == "wall" else NOTHING for name in pattern.panel_names]


def misfit(pattern: Pattern, regions: list[BaseGeometry]) -> float:
    """Smaller part of each triangle, printed or bare, over the printed area."""
    total = 0.0
    for panel, region in enumerate(regions):
        cells = np.flatnonzero(pattern.panel == panel)
        covered = shapely.area(
            shapely.intersection(shapely.polygons(pattern.corners[cells]), region)
        )
        total += np.minimum(covered, pattern.areas[cells] - covered).sum()
    return float(total / sum(region.area for region in regions))


def smallest_angle(pattern: Pattern) -> float:
    return float(corner_angles(pattern.flat_points, pattern.flat_triangles).min())


@pytest.mark.parametrize(("mesh", "left"), [("unstructured", 0.15), ("structured", 0.6)])
def test_borders_are_met_with_good_triangles(alone: MPI.Comm, mesh: str, left: float) -> None:
    pattern = cylinder(alone, 0.04, 2 * RADIUS, 1.2e-3, mesh=mesh)
    regions = helices(pattern, np.ptp(pattern.corners[..., 0][pattern.cells_of("wall")]))
    found = snapped(alone, pattern, regions)
    assert misfit(found, regions) < left * misfit(pattern, regions)
    assert smallest_angle(found) > LEAST_ANGLE - 1e-12
    for name in ("flat_triangles", "panel", "sewn"):
        assert np.array_equal(getattr(found, name), getattr(pattern, name))
    again = snapped(alone, pattern, regions)
    assert np.array_equal(again.flat_points, found.flat_points)
    assert np.array_equal(again.points, found.points)


def test_outlines_and_seams_are_kept(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.06, 2 * RADIUS, 1.5e-3)
    wall = pattern.cells_of("wall")
    regions = helices(pattern, np.ptp(pattern.corners[wall][..., 0]))
    found = snapped(alone, pattern, regions)
    for panel in range(3):
        cells = pattern.panel == panel
        assert found.areas[cells].sum() == pytest.approx(pattern.areas[cells].sum(), rel=1e-12)
    # Of the seam along the tube both sides have moved alike, those of the caps stay.
    sides = np.array([pattern.flat_points[pattern.seams], found.flat_points[found.seams]])
    length = np.linalg.norm(np.diff(sides[1], axis=2)[..., 0, :], axis=2)
    assert length[:, 0] == pytest.approx(length[:, 1], rel=1e-6)
    moved = np.any(sides[0] != sides[1], axis=(1, 2, 3))
    panel_of = np.zeros(len(pattern.flat_points), dtype=int)
    panel_of[pattern.flat_triangles] = pattern.panel[:, None]
    one, two = panel_of[pattern.seams[:, :, 0]].T
    caps = one != two
    assert np.count_nonzero(moved[~caps]) > 5
    assert not np.any(moved[caps])


@pytest.mark.parametrize("planes", [(1,), (0, 1)])
def test_parts_still_meet_their_images(alone: MPI.Comm, planes: tuple[int, ...]) -> None:
    part = cylinder(alone, 0.06, 2 * RADIUS, 1.5e-3, planes=planes)
    around = 2 * np.pi * RADIUS
    found = snapped(alone, part, helices(part, around))
    before, after = mirrored(part, planes).pattern, mirrored(found, planes).pattern
    assert len(after.points) == len(before.points)
    assert not len(after.free_edges)
    assert after.areas.sum() == pytest.approx(before.areas.sum(), rel=1e-12)
    moved = np.any(found.points != part.points, axis=1)
    for axis in planes:
        assert np.any(moved[part.points[:, axis] == 0])


def test_round_outline_stays(alone: MPI.Comm) -> None:
    """Where an outline turns at each vertex none of it moves; inside, all do."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    pattern = two_panels(alone, 0.03 * np.column_stack([np.cos(angle), np.sin(angle)]), 2e-3)
    disc = shapely.Point(0.002, 0.001)
    regions = [disc.buffer(0.012), disc.buffer(0.04).difference(disc.buffer(0.02))]
    found = snapped(alone, pattern, regions)
    assert misfit(found, regions) < 0.2 * misfit(pattern, regions)
    seam = np.unique(pattern.seams)
    assert np.array_equal(found.flat_points[seam], pattern.flat_points[seam])
    assert smallest_angle(found) > LEAST_ANGLE - 1e-12


def test_nothing_printed_moves_nothing(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.06, 2 * RADIUS, 4e-3)
    found = snapped(alone, pattern, [NOTHING] * 3)
    assert np.array_equal(found.flat_points, pattern.flat_points)
    assert np.array_equal(found.points, pattern.points)
    corners = pattern.corners[pattern.cells_of("wall")].reshape(-1, 2)
    whole = [shapely.box(*corners.min(axis=0), *corners.max(axis=0)), NOTHING, NOTHING]
    assert np.array_equal(snapped(alone, pattern, whole).points, pattern.points)


def test_seam_vertices_move_to_where_a_line_crosses(alone: MPI.Comm) -> None:
    """A line around the edge of two sewn panels: both sides meet its borders at one vertex."""
    outline = np.array([[0, 0], [0.05, 0], [0.05, 0.02], [0, 0.02]])
    pattern = two_panels(alone, outline, 2.3e-3)
    line = shapely.box(0.0103, -1.0, 0.0202, 1.0)
    regions = [line.intersection(shapely.box(0, y, 0.05, y + 0.02)) for y in (0.0, -0.02)]
    found = snapped(alone, pattern, regions)
    assert misfit(found, regions) < 0.02
    for side in range(2):
        seam = found.flat_points[np.unique(found.seams[:, side])]
        for border in (0.0103, 0.0202):
            near = np.abs(seam[:, 0] - border) < 1e-7
            assert np.count_nonzero(near) == 2
    corners = np.isin(pattern.points[:, 0], [0.0, 0.05]) & np.isin(pattern.points[:, 1], [0, 0.02])
    assert np.count_nonzero(corners) == 4
    assert np.array_equal(found.points[corners], pattern.points[corners])


SIZE = 0.02
LARGEST = 1e-4


def following(pattern: Pattern, regions: list) -> tuple[Pattern, np.ndarray]:
    """The pattern on the borders of regions, and which of its triangles are printed."""
    pattern = snapped(MPI.COMM_SELF, pattern, regions)
    return pattern, printed_cells(pattern, regions)


def printed_area(pattern: Pattern, printed: np.ndarray) -> float:
    return float(pattern.areas[printed].sum())


def area_rate(pattern: Pattern, regions: list, printed: np.ndarray) -> float:
    motion = border_motion(pattern, regions, printed, LARGEST)
    ends = [
        printed_area(with_flat_points(pattern, pattern.flat_points + way * motion), printed)
        for way in (-LARGEST, LARGEST)
    ]
    return (ends[1] - ends[0]) / (2 * LARGEST)


def test_straight_lines_grow_by_length_times_way() -> None:
    """A slanted line across the panel: both ends slide along the panel's border."""
    line = shapely.Polygon([(4e-3, 0), (7e-3, 0), (13e-3, SIZE), (10e-3, SIZE)])
    pattern, printed = following(square(n=20, size=SIZE), [line])
    perimeter = 2 * np.hypot(6e-3, SIZE)
    assert area_rate(pattern, [line], printed) == pytest.approx(perimeter, rel=2e-3)
    motion = border_motion(pattern, [line], printed, LARGEST)
    edge = np.isin(pattern.flat_points[:, 1], (0.0, SIZE))
    assert np.abs(motion[edge, 0]).max() > 1, "they slide further than the border goes"
    assert np.all(motion[edge, 1] == 0), "and stay on it"


@pytest.mark.parametrize("count", [20, 40])
def test_discs_and_holes_grow_by_perimeter_times_way(count: int) -> None:
    """To the order of the mesh; a border's chords are shorter than its arcs."""
    ring = shapely.Point(SIZE / 2, SIZE / 2).buffer(7e-3, 64)
    ring = ring.difference(shapely.Point(SIZE / 2, SIZE / 2).buffer(3e-3, 64))
    pattern, printed = following(square(n=count, size=SIZE), [ring])
    found = area_rate(pattern, [ring], printed)
    assert found == pytest.approx(ring.length, rel=0.06 * 20 / count)


def test_both_sides_of_a_seam_slide_alike() -> None:
    """A ring around a tube crosses its seam: the tube is still sewn, and round."""
    pattern = cylinder(MPI.COMM_SELF, 0.06, 0.02, 4e-3)
    wall = pattern.panel_index("wall")
    regions = [shapely.Polygon() for _ in pattern.panel_names]
    regions[wall] = shapely.box(-1, 0.0211, 1, 0.0289)
    pattern, printed = following(pattern, regions)
    motion = border_motion(pattern, regions, printed, LARGEST)
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
    pattern, printed = following(square(n=20, size=SIZE), [line])
    motion = border_motion(pattern, [line], printed, 1.2e-3)
    for sign in (-1, 1):
        moved = with_flat_points(pattern, pattern.flat_points + sign * 1.2e-3 * motion)
        assert moved.areas.min() > 0
    assert np.abs(motion).max() < 1


def test_plain_and_full_panels_do_not_move() -> None:
    pattern = square()
    for regions, value in (([shapely.Polygon()], False), ([shapely.box(0, 0, SIZE, SIZE)], True)):
        printed = np.full(len(pattern.panel), value)
        assert not border_motion(pattern, regions, printed, LARGEST).any()
