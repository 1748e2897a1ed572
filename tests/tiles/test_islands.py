"""Islands of a tile's print."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import tile
from toros_fem.tiles.islands import island_areas


def test_islands(comm: MPI.Comm) -> None:
    """A line through the border is connected; a spot is an island, also across the border."""
    patch = tile(comm, 0.01, 1e-3)
    x, y = 1e3 * patch.pattern.centroids.T
    line = np.abs(y - 5) < 1
    spot = np.hypot(x - 5, y - 9) < 0.9
    corner = np.hypot((x + 5) % 10 - 5, (y + 5) % 10 - 5) < 2
    assert len(island_areas(patch, line)) == 0
    assert len(island_areas(patch, np.abs((x + y) % 10 - 5) < 1)) == 0
    areas = patch.pattern.areas
    assert island_areas(patch, line | spot) == pytest.approx([areas[spot].sum()])
    assert island_areas(patch, corner) == pytest.approx([areas[corner].sum()])
    assert island_areas(patch, corner | line | spot) == pytest.approx(
        [areas[corner].sum(), areas[spot].sum()]
    )
    assert len(island_areas(patch, np.ones(len(x), dtype=bool))) == 0
    assert len(island_areas(patch, np.zeros(len(x), dtype=bool))) == 0
