"""What `backward` says is how much `forward` changes, and no number of ranks changes either."""

import numpy as np
import pytest
from kit.pairs import ON_ONE_RANK, ROWS, Make
from kit.slopes import slope
from mpi4py import MPI

from toros_fem.base.mpi import dot

# A gradient that hardly points along the drawn direction would prove little.
SEEN = 1e-3


@pytest.mark.parametrize("make", ROWS.values(), ids=ROWS)
def test_forward_and_backward(make: Make, comm: MPI.Comm) -> None:
    stage = make(comm)
    told = np.array([dot(stage.comm, row.ravel(), stage.step.ravel()) for row in stage.gradients])
    found = slope(lambda h: stage.values(stage.point + h * stage.step))
    length = np.sqrt(dot(stage.comm, stage.step.ravel(), stage.step.ravel()))
    scale = length * np.sqrt([dot(stage.comm, g.ravel(), g.ravel()) for g in stage.gradients])
    assert np.all(np.abs(told - found) <= stage.tolerance * scale)
    assert np.all(np.abs(told) > SEEN * scale)
    if comm.size > 1:
        alone = make(MPI.COMM_SELF)
        assert stage.values(stage.point) == pytest.approx(alone.values(alone.point), rel=1e-8)
        for one, other in zip(stage.gradients, alone.gradients, strict=True):
            expected = alone.gather(other)
            largest = np.abs(expected).max()
            assert stage.gather(one) == pytest.approx(expected, rel=1e-8, abs=1e-8 * largest)


@pytest.mark.parametrize("make", ON_ONE_RANK.values(), ids=ON_ONE_RANK)
def test_on_one_rank(make: Make, alone: MPI.Comm) -> None:
    test_forward_and_backward(make, alone)
