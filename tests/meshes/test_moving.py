"""Vertices at the borders of a print move with them."""

import numpy as np
import pytest
import shapely
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.meshes import Pattern, cylinder
from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.moving import border_motion, with_flat_points

SIZE = 0.02
LARGEST = 1e-4


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
