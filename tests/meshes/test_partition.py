"""Parts of a pattern: compact, of equal size, and the same in every run."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import cylinder, sew, walker
from toros_fem.meshes.partition import parts_of
from toros_fem.meshes.robots import Star


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_parts_have_equal_sizes_and_short_borders(count: int) -> None:
    pattern = cylinder(MPI.COMM_SELF, 0.15, 0.02, 4e-3)
    part = parts_of(pattern, count)
    sizes = np.bincount(part, minlength=count)
    assert len(sizes) == count
    assert np.ptp(sizes) <= count.bit_length()
    one, two = part[pattern.edges.twins[pattern.edges.inner] // 3].T
    around = np.pi * 0.02 / 4e-3
    assert (one != two).sum() <= 2.5 * around * (count - 1), "cuts go around, not along"


def test_ranks_own_their_parts_in_every_run(comm: MPI.Comm) -> None:
    star = Star(4, 0.04, 0.02, 0.02, 6e-3, np.pi / 4)
    pattern = walker(comm, 5e-3, star)
    part = parts_of(pattern, comm.size)
    for _ in range(3):
        skin = sew(comm, pattern)
        assert np.array_equal(np.sort(skin.owned_cells), np.flatnonzero(part == comm.rank))
        # Ghosts are the neighbours across edges.
        ghosts = skin.cell[len(skin.owned_cells) :]
        twins = pattern.edges.twins[pattern.edges.inner] // 3
        near = np.concatenate([twins, twins[:, ::-1]])
        across = near[(part[near[:, 0]] == comm.rank) & (part[near[:, 1]] != comm.rank), 1]
        assert np.array_equal(np.sort(ghosts), np.unique(across))
