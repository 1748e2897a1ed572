"""Densities: random start and check."""

import numpy as np
from mpi4py import MPI

from toros_fem.design.density.field import random_density
from toros_fem.meshes import Skin, sew


def test_random_density(tube: Skin, comm: MPI.Comm) -> None:
    whole = tube.gather_cells(random_density(tube, 7))
    alone = sew(MPI.COMM_SELF, tube.pattern)
    assert np.array_equal(whole, alone.gather_cells(random_density(alone, 7)))
    assert not np.array_equal(whole, tube.gather_cells(random_density(tube, 8)))
    assert whole.min() >= 0.4
    assert whole.max() <= 0.6
