"""Rounded corners and meshes of flat regions."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import rounded, two_panels
from toros_fem.meshes.makers.planar import arc

ELL = np.array([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.05], [0, 0.05]])


def test_rounded_convex_and_concave_corners() -> None:
    radius = 4e-3
    points = rounded(ELL, radius)
    x, y = points.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    # Five corners lose what the inner one gains, all of 90 degrees.
    exact = 18e-4 - 4 * (1 - np.pi / 4) * radius**2
    assert area == pytest.approx(exact, rel=1e-4)
    inner = points[np.linalg.norm(points - [0.024, 0.024], axis=1) < 1.001 * radius]
    assert np.linalg.norm(inner - [0.024, 0.024], axis=1) == pytest.approx(radius, rel=1e-12)
    sharp = rounded(ELL, [0, radius, radius, radius, radius, 0])
    assert sharp[0] == pytest.approx([0, 0])
    assert sharp[-1] == pytest.approx([0, 0.05])


def test_inner_edge_between_borders_is_halved(alone: MPI.Comm) -> None:
    """A strip one triangle wide has nothing but such edges."""
    strip = np.array([[0, 0], [0.03, 0], [0.03, 4e-3], [0, 4e-3]])
    pattern = two_panels(alone, strip, 3.5e-3)
    pattern.require_closed()
    seam = np.intersect1d(pattern.vertices_of("top"), pattern.vertices_of("bottom"))
    top = pattern.triangles[pattern.cells_of("top")]
    assert not np.isin(top, seam).all(axis=1).any()


def test_arcs() -> None:
    points = arc([1, 2], 0.5, 0, np.pi / 2)
    assert len(points) == 19
    assert points[[0, -1]] == pytest.approx(np.array([[1.5, 2], [1, 2.5]]), abs=1e-15)
    assert np.linalg.norm(points - [1, 2], axis=1) == pytest.approx(0.5)
