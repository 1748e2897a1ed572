"""Helmholtz filter: exact response, and seams."""

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.design.density.filters import cone_filter, helmholtz_filter
from toros_fem.meshes import Skin, sew


def test_waves_are_damped_by_the_radius() -> None:
    """Along a strip cos kx is smoothed to cos kx / (1 + k² r²), r = R/(2 √3): two meshes."""
    size, radius, found = 0.06, 9e-3, []
    k = 2 * np.pi / size
    for n in (24, 48):
        skin = sew(MPI.COMM_SELF, square(n=n, size=size))
        wave = np.cos(k * skin.pattern.centroids[skin.owned_cells, 0])
        smooth = helmholtz_filter(skin, radius).forward(wave)
        found.append(smooth @ wave / (wave @ wave))
    extrapolated = found[1] + (found[1] - found[0]) / 3
    assert extrapolated == pytest.approx(1 / (1 + k**2 * radius**2 / 12), rel=1e-4)


def test_helmholtz_crosses_seams_the_cone_does_not(short_tube: Skin) -> None:
    pattern = short_tube.pattern
    cap = pattern.panel[short_tube.owned_cells] == pattern.panel_index("base")
    density = cap.astype(float)
    wall = pattern.cells_of("wall")
    near = wall[pattern.centroids[wall, 1] < 3e-3]
    assert (
        short_tube.gather_cells(helmholtz_filter(short_tube, 8e-3).forward(density))[near].min()
        > 0.1
    )
    assert short_tube.gather_cells(cone_filter(short_tube, 8e-3).forward(density))[near].max() == 0
    # Left and right border of the wall are one line of the skin.
    left = pattern.centroids[:, 0] < 4e-3
    density = (left & (pattern.panel == pattern.panel_index("wall"))).astype(float)
    across = wall[pattern.centroids[wall, 0] > pattern.centroids[wall, 0].max() - 2e-3]
    found = short_tube.gather_cells(
        helmholtz_filter(short_tube, 8e-3).forward(density[short_tube.owned_cells])
    )
    assert found[across].min() > 0.1
