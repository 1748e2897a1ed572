"""Helmholtz filter: exact response, and seams."""

import numpy as np
from mpi4py import MPI

from toros_fem.design.density.cone import ConeFilter
from toros_fem.design.density.helmholtz import HelmholtzFilter
from toros_fem.meshes import Skin, cylinder, sew


def test_helmholtz_of_a_half_plane(comm: MPI.Comm) -> None:
    """Against the exact response to a straight edge."""
    skin = sew(comm, cylinder(comm, 0.05, 0.02, 1.2e-3))
    pattern, radius, edge = skin.pattern, 9e-3, 0.025
    step = (pattern.centroids[skin.owned_cells, 1] > edge).astype(float)
    step[pattern.panel[skin.owned_cells] == pattern.panel_index("tip")] = 1.0
    filtered = skin.gather_cells(HelmholtzFilter(skin, radius).forward(step))
    wall = pattern.cells_of("wall")
    d = (pattern.centroids[wall, 1] - edge) / radius
    exact = 0.5 + 0.5 * np.sign(d) * (1 - np.exp(-np.abs(d) * 2 * np.sqrt(3)))
    near = np.abs(d) < 1
    assert np.abs(filtered[wall[near]] - exact[near]).max() < 0.05
    assert np.abs(filtered[wall[near]] - exact[near]).mean() < 0.012
    assert filtered.min() >= 0
    assert filtered.max() <= 1


def test_helmholtz_crosses_seams_the_cone_does_not(tube: Skin) -> None:
    pattern = tube.pattern
    cap = pattern.panel[tube.owned_cells] == pattern.panel_index("base")
    density = cap.astype(float)
    wall = pattern.cells_of("wall")
    near = wall[pattern.centroids[wall, 1] < 3e-3]
    assert tube.gather_cells(HelmholtzFilter(tube, 8e-3).forward(density))[near].min() > 0.1
    assert tube.gather_cells(ConeFilter(tube, 8e-3).forward(density))[near].max() == 0
    # Left and right border of the wall are one line of the skin.
    left = pattern.centroids[:, 0] < 4e-3
    density = (left & (pattern.panel == pattern.panel_index("wall"))).astype(float)
    across = wall[pattern.centroids[wall, 0] > pattern.centroids[wall, 0].max() - 2e-3]
    found = tube.gather_cells(HelmholtzFilter(tube, 8e-3).forward(density[tube.owned_cells]))
    assert found[across].min() > 0.1
