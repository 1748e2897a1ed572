"""Refined patterns are the same panels with four times the triangles."""

from mpi4py import MPI

from toros_fem.meshes import cylinder
from toros_fem.meshes.refine import refine
from toros_fem.meshes.topology import flat_areas


def test_a_quarter_lies_in_its_triangle(comm: MPI.Comm) -> None:
    """Barycentric coordinates of each quarter's centroid are at least 1/6."""
    tube = cylinder(comm, 0.06, 0.02, 5e-3)
    found = refine(tube)
    corners, centre = tube.corners[found.cell], found.pattern.centroids
    for k in range(3):
        part = corners.copy()
        part[:, k] = centre
        assert (flat_areas(part) / flat_areas(corners)).min() > 1 / 6 - 1e-9
