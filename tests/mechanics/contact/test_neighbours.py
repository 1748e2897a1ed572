"""Neighbours in the sheet: distances along it, and what contact leaves out or not."""

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from toros_fem.mechanics.contact.layers import (
    FLAT,
    FOLDED,
    ContactSizes,
    collision_filter,
    leaving_out,
    neighbours,
    paths,
)
from toros_fem.meshes import Pattern, cylinder, finger, rectangle
from toros_fem.meshes.triangles import edges_of, lengths

SIZES = ContactSizes(5e-4, 2.5e-4, 1e5, 1e-4)
COMM = MPI.COMM_SELF


def collisions(pattern: Pattern, positions: np.ndarray, within: float) -> Any:
    ipctk = pytest.importorskip("ipctk")
    mesh = ipctk.CollisionMesh(
        np.asfortranarray(positions),
        np.asfortranarray(pattern.edges.ends, dtype=np.int32),
        np.asfortranarray(pattern.triangles, dtype=np.int32),
    )
    mesh.can_collide = leaving_out(neighbours(pattern, SIZES))
    found = ipctk.NormalCollisions()
    found.build(mesh, np.asfortranarray(positions), within)
    return found


def test_paths_are_those_of_dijkstra() -> None:
    pattern = finger(COMM, 3e-3)
    one, two = pattern.edges.ends.T
    length, count = lengths(pattern.points, pattern.edges.ends), len(pattern.points)
    found = paths(count, one, two, length, 8e-3)
    graph = coo_array((length, (one, two)), shape=(count, count))
    whole = dijkstra(graph, directed=False, limit=8e-3)
    np.fill_diagonal(whole, np.inf)
    np.testing.assert_array_equal(found, np.argwhere(np.isfinite(whole)))


def test_neighbours_of_a_fine_sheet_are_those_near_along_it() -> None:
    pattern = rectangle(COMM, 8e-3, 8e-3, 4e-4, "unstructured")
    found = neighbours(pattern, SIZES)
    apart = np.linalg.norm(pattern.points[:, None] - pattern.points, axis=2)
    one, two = np.nonzero(np.triu(apart < 0.9 * FOLDED * SIZES.thickness, 1))
    count = len(pattern.points)
    keys = found[:, 0] * count + found[:, 1]
    assert np.isin(one * count + two, keys).all()
    # Edges that a path joins bring their own ends, and those of their neighbours.
    longest = lengths(pattern.points, pattern.edges.ends).max()
    assert lengths(pattern.points, found).max() < FLAT * SIZES.reach + 3 * longest
    assert (np.diff(keys) > 0).all()
    assert (found[:, 0] < found[:, 1]).all()


def test_neighbours_across_the_seam_of_a_tube_are_those_in_its_wall() -> None:
    """A structured tube is the same all around, so that each vertex of a ring has as many."""
    pattern = cylinder(COMM, 0.02, 0.01, 4.6e-4, mesh="structured", caps=None)
    found = neighbours(pattern, SIZES)
    number = np.bincount(found.ravel(), minlength=len(pattern.points))
    middle = np.abs(pattern.points[:, 2] - 0.01) < 2e-3
    assert len(np.unique(number[middle])) == 1
    assert number[middle][0] > 20


@pytest.mark.parametrize("mesh", ["unstructured", "right", "crossed"])
@pytest.mark.parametrize("edge", [4e-4, 7e-4, 1.2e-3, 2e-3])
def test_contact_does_not_act_in_a_flat_sheet(mesh: str, edge: float) -> None:
    pattern = rectangle(COMM, 0.012, 0.012, edge, mesh)
    assert len(collisions(pattern, pattern.points, SIZES.reach)) == 0


def test_contact_does_not_act_between_slivers_of_a_flat_sheet() -> None:
    """Triangles that are lower than the sheet is thick, with long edges."""
    pattern = rectangle(COMM, 0.04, 0.04, 4e-3, "right")
    flat = pattern.flat_points * [1.0, 0.06]
    points = np.column_stack([flat, np.zeros(len(flat))])
    squeezed = Pattern(
        flat, pattern.flat_triangles, pattern.panel, pattern.sewn, points, pattern.panel_names
    )
    assert len(collisions(squeezed, points, SIZES.reach)) == 0


def test_contact_prevents_a_sharp_fold_of_two_triangles() -> None:
    """Edges of 2 mm: nothing is left out; folded shut, the corners touch the other triangle."""
    flat = np.array([[0.0, 0.0], [2e-3, 0.0], [1e-3, 1.7e-3], [1e-3, -1.7e-3]])
    triangles = np.array([[0, 1, 2], [1, 0, 3]])
    points = np.column_stack([flat, np.zeros(4)])
    pattern = Pattern(flat, triangles, np.zeros(2, int), np.arange(4), points, ("sheet",))
    assert len(neighbours(pattern, SIZES)) == 0
    folded = points.copy()
    angle = np.radians(170)
    folded[3] = [1e-3, -1.7e-3 * np.cos(angle), 1.7e-3 * np.sin(angle)]
    assert len(collisions(pattern, points, SIZES.reach)) == 0
    assert len(collisions(pattern, folded, SIZES.reach)) > 0


def test_filter_of_bodies_mounts_and_skins_without_self_contact() -> None:
    pytest.importorskip("ipctk")
    pattern = rectangle(COMM, 0.02, 0.02, 1e-2)  # nine vertices
    assert len(edges_of(pattern.triangles).ends) == 16
    prescribed = np.arange(9) < 2
    held, moved, free, other = 9, 11, 13, 15
    given: Any = prescribed, (2, 2, 2, 2), (2, 3)
    touch = collision_filter(*given, self_contact=True)
    assert touch(4, 8)
    assert touch(0, 8)
    assert touch(4, held)
    assert touch(0, free)
    assert touch(held, free)
    assert touch(free, other)
    assert not touch(0, 1)
    assert touch(0, held)  # a support may be moved into a body
    assert not touch(held, moved)
    assert not touch(free, free + 1)
    assert not touch(held, held + 1)
    touch = collision_filter(*given, self_contact=False)
    assert touch(4, held)
    assert touch(4, free)
    assert touch(held, free)
    assert not touch(4, 8)
    assert touch(0, held)
    assert not touch(free, free + 1)
