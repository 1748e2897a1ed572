"""Copies of vertices and triangles, needles and caps are repaired."""

from pathlib import Path

import numpy as np
import pytest
from helpers import surfaces
from helpers.mesh_files import write
from mpi4py import MPI

from toros_fem.meshes import read_surface
from toros_fem.meshes.topology import edges_of, shapes


def test_needles_and_caps_are_mended(comm: MPI.Comm, folder: Path) -> None:
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
    path = write(comm, folder / "bad.obj", points, [("triangle", triangles)])
    found = read_surface(comm, path)
    assert found.repairs.collapsed == 1
    assert found.repairs.flipped == 1
    assert shapes(found.points, found.triangles).min() > 1e-3
    assert found.closed
    assert found.area == pytest.approx(ball.area, rel=0.02)


def test_caps_at_a_border_are_dropped_unless_that_tears(comm: MPI.Comm, folder: Path) -> None:
    """The apex inside, the apex on the border too, an ear, and a cap that is all there is."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 5e-4, 0], [0, 1, 0], [1, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 4], [2, 4, 3]])
    for kept, dropped in (([0, 1, 2, 3], 1), ([0, 1, 2], 0), ([0, 1], 1), ([0], 0)):
        path = write(comm, folder / "sheet.ply", points, [("triangle", triangles[kept])])
        found = read_surface(comm, path)
        assert found.repairs.dropped == dropped
        assert len(found.triangles) == len(kept) - dropped
