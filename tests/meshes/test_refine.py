"""Refined patterns are the same panels with four times the triangles."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import cylinder
from toros_fem.meshes.refine import refine
from toros_fem.meshes.topology import flat_areas


def test_refined_tube(comm: MPI.Comm) -> None:
    tube = cylinder(comm, 0.06, 0.02, 5e-3)
    found = refine(tube)
    fine = found.pattern
    fine.require_closed()
    assert fine.panel_names == tube.panel_names
    assert np.array_equal(fine.panel, tube.panel[found.cell])
    assert fine.areas == pytest.approx(tube.areas[found.cell] / 4, rel=1e-9)
    assert len(fine.seams) == 2 * len(tube.seams)
    # Euler's formula: one vertex more for each edge.
    assert len(fine.points) == len(tube.points) + len(tube.edges.ends)


def test_values_are_interpolated(comm: MPI.Comm) -> None:
    tube = cylinder(comm, 0.06, 0.02, 5e-3)
    found = refine(tube)
    assert found.at_vertices(tube.points) == pytest.approx(found.pattern.points, abs=1e-18)
    old = found.ends[:, 0] == found.ends[:, 1]
    assert old.sum() == len(tube.points)
    values = np.random.default_rng(0).normal(size=len(tube.points))
    assert np.array_equal(found.at_vertices(values)[old], values)


def test_a_quarter_lies_in_its_triangle(comm: MPI.Comm) -> None:
    """Barycentric coordinates of each quarter's centroid are at least 1/6."""
    tube = cylinder(comm, 0.06, 0.02, 5e-3)
    found = refine(tube)
    corners, centre = tube.corners[found.cell], found.pattern.centroids
    for k in range(3):
        part = corners.copy()
        part[:, k] = centre
        assert (flat_areas(part) / flat_areas(corners)).min() > 1 / 6 - 1e-9
