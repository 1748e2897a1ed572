"""Copies of vertices and triangles, needles and caps are repaired."""

from pathlib import Path

import numpy as np
import pytest
from helpers import surfaces
from helpers.mesh_files import write
from mpi4py import MPI

from toros_fem.meshes import read_surface
from toros_fem.meshes.surfaces.repair import remove_thin, weld
from toros_fem.meshes.triangles import edges_of, shapes


def test_needles_and_caps_are_repaired(alone: MPI.Comm, tmp_path: Path) -> None:
    ball = surfaces.sphere(2)
    points, triangles = ball.points.copy(), ball.triangles
    edges = edges_of(triangles)
    # A needle: a vertex almost at its neighbour. A cap: one split into three, off its centre.
    a, b = edges.ends[100]
    points[a] += (1 - 1e-5) * (points[b] - points[a])
    p, q, r = triangles[200]
    points = np.vstack([points, (points[p] + points[q]) / 2 + 1e-6 * (points[r] - points[p])])
    new = len(points) - 1
    triangles = np.vstack(
        [np.delete(triangles, 200, axis=0), [[p, q, new], [q, r, new], [r, p, new]]]
    )
    assert shapes(points, triangles).min() < 1e-4
    path = write(alone, tmp_path / "bad.obj", points, [("triangle", triangles)])
    found = read_surface(alone, path)
    assert found.repairs == "1 edges collapsed, 1 edges flipped"
    assert shapes(found.points, found.triangles).min() > 1e-3
    assert found.closed
    assert found.area == pytest.approx(ball.area, rel=0.02)


def test_caps_at_a_border_are_dropped_unless_that_tears(alone: MPI.Comm, tmp_path: Path) -> None:
    """The apex inside, the apex on the border too, an ear, and a cap that is all there is."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 5e-4, 0], [0, 1, 0], [1, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 4], [2, 4, 3]])
    for kept, dropped in (([0, 1, 2, 3], 1), ([0, 1, 2], 0), ([0, 1], 1), ([0], 0)):
        path = write(alone, tmp_path / "sheet.ply", points, [("triangle", triangles[kept])])
        found = read_surface(alone, path)
        assert found.repairs == ("1 triangles dropped" if dropped else "none")
        assert len(found.triangles) == len(kept) - dropped


@pytest.mark.parametrize("noise", [0, 1e-13, 1e-9, 3e-8])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_vertices_are_merged_by_distance(noise: float, unit: float) -> None:
    """Three copies or more of each vertex, apart by a fraction of the size, in any unit."""
    ball = surfaces.sphere(3)
    rng = np.random.default_rng(0)
    size = np.linalg.norm(np.ptp(ball.points, axis=0))
    points = ball.points[ball.triangles].reshape(-1, 3)
    points = points + noise * size / np.sqrt(3) * rng.uniform(-0.5, 0.5, points.shape)
    corners = np.arange(len(points)).reshape(-1, 3)
    replaced_by, kept = weld(unit * points, corners)
    assert len(np.unique(replaced_by)) == len(ball.points)
    assert np.array_equal(kept, np.arange(len(corners)))
    assert len(edges_of(replaced_by[corners]).border) == 0


def test_copies_and_degenerate_triangles_are_left_out() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 1e-9], [5, 5, 5.0]])
    triangles = np.array([[0, 1, 2], [2, 1, 0], [1, 3, 2], [3, 2, 0], [0, 1, 4]])
    replaced_by, kept = weld(points, triangles)
    assert replaced_by.tolist() == [0, 1, 2, 1, 4]
    assert kept.tolist() == [0, 4]


def test_kept_edges_and_borders_of_parts_are_not_repaired() -> None:
    """A cap whose long edge is kept, or divides two parts, stays as it is."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-5, 0], [0.5, -1, 0], [0.5, 1, 0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 4]])
    free = remove_thin(points, triangles, np.zeros(4, dtype=int), np.zeros((0, 2), dtype=int))
    assert free[-1] == {"edges flipped": 1}
    assert shapes(free[0], free[1]).min() > 0.3
    for parts, kept in ((np.array([0, 1, 0, 0]), np.zeros((0, 2), dtype=int)),
                        (np.zeros(4, dtype=int), np.array([[1, 0]]))):  # fmt: skip
        found = remove_thin(points, triangles, parts, kept)
        assert not found[-1]
        assert np.array_equal(found[1], triangles)
