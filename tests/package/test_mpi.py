"""Reductions and errors are the same on all ranks."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import _mpi


def test_reductions(comm: MPI.Comm) -> None:
    ranks = np.arange(1.0, comm.size + 1)
    own = float(comm.rank + 1)
    assert _mpi.total(comm, own) == ranks.sum()
    assert _mpi.largest(comm, own) == ranks.max()
    assert _mpi.smallest(comm, own) == ranks.min()
    assert _mpi.dot(comm, np.array([own, own]), np.array([1.0, 2.0])) == 3 * ranks.sum()
    assert _mpi.norm(comm, np.array([own])) == pytest.approx(np.linalg.norm(ranks))
    found = _mpi.sum_over_ranks(comm, np.array([[own, 2 * own]]))
    np.testing.assert_array_equal(found, ranks.sum() * np.array([[1.0, 2.0]]))


def test_rows_by_index(comm: MPI.Comm) -> None:
    """Each rank gives the row of its number; the last row is given by none."""
    rows = np.array([[comm.rank + 1.0, -1.0]])
    found = _mpi.gather_by_index(comm, np.array([comm.rank]), rows, comm.size + 1)
    assert found[:-1, 0].tolist() == list(range(1, comm.size + 1))
    assert (found[:-1, 1] == -1).all()
    assert (found[-1] == 0).all()


def test_an_error_of_one_rank_is_raised_on_all(comm: MPI.Comm) -> None:
    _mpi.raise_together(comm, None)
    last = comm.size - 1
    with pytest.raises(ValueError, match=f"rank {last}$"):
        _mpi.raise_together(comm, ValueError(f"rank {last}") if comm.rank == last else None)
    with pytest.raises(ValueError, match="rank 0$"):
        _mpi.raise_together(comm, ValueError(f"rank {comm.rank}"))


def test_first_rank_acts_for_all(comm: MPI.Comm) -> None:
    calls: list[int] = []

    def act() -> str:
        calls.append(comm.rank)
        return f"done on {comm.rank}"

    assert _mpi.on_first_rank(comm, act) == "done on 0"
    assert calls == ([0] if comm.rank == 0 else [])

    def fail() -> None:
        raise OSError("no space")

    with pytest.raises(OSError, match="no space"):
        _mpi.on_first_rank(comm, fail)
