"""Surfaces are cut open to discs."""

from collections.abc import Callable

import numpy as np
import pytest
from helpers import surfaces

from toros_fem.meshes import Surface
from toros_fem.meshes.cut import cut_open, disc_cuts, euler
from toros_fem.meshes.topology import edges_of, lengths


@pytest.mark.parametrize(("make", "chi"), [(surfaces.sphere, 2), (surfaces.torus, 0)])
def test_closed_surfaces_are_cut_to_discs(make: Callable[[], Surface], chi: int) -> None:
    surface = make()
    assert euler(surface.triangles) == chi
    edges = edges_of(surface.triangles)
    seams = np.zeros(len(edges.ends), dtype=bool)
    seams[disc_cuts(surface.points, surface.triangles, tips=False)] = True
    cut = cut_open(surface.triangles, edges, seams)
    assert cut.chart.max() == 0
    assert euler(cut.triangles) == 1
    border = edges_of(cut.triangles)
    ends = border.ends[border.border]
    assert np.bincount(ends.ravel()).max() == 2, "one loop"
    if chi == 0:  # around the tube and around its inside: the shortest pair of loops
        shortest = 24 * 2 * 0.013 * np.sin(np.pi / 24) + 12 * 2 * 0.007 * np.sin(np.pi / 12)
        assert lengths(surface.points, edges.ends[seams]).sum() < 1.3 * shortest
