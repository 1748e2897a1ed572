"""Vertices moved onto the borders of polygons: what fits better, and what stays."""

import numpy as np
import pytest
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.meshes import Pattern, cylinder, mirrored, two_panels
from toros_fem.meshes.snap import LEAST_ANGLE, snapped
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
