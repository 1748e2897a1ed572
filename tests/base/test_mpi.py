"""Reductions and errors are the same on all ranks."""

import logging
import warnings

import numpy as np
import pytest
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base import mpi
from toros_fem.base.errors import TorosWarning
from toros_fem.base.mpi import warn_together
from toros_fem.design.density.filters import make_filter


def test_reductions(comm: MPI.Comm) -> None:
    ranks = np.arange(1.0, comm.size + 1)
    own = float(comm.rank + 1)
    assert mpi.total(comm, own) == ranks.sum()
    assert mpi.largest(comm, own) == ranks.max()
    assert mpi.smallest(comm, own) == ranks.min()
    assert mpi.dot(comm, np.array([own, own]), np.array([1.0, 2.0])) == 3 * ranks.sum()
    assert mpi.norm(comm, np.array([own])) == pytest.approx(np.linalg.norm(ranks))
    found = mpi.sum_over_ranks(comm, np.array([[own, 2 * own]]))
    np.testing.assert_array_equal(found, ranks.sum() * np.array([[1.0, 2.0]]))


def test_rows_by_index(comm: MPI.Comm) -> None:
    """Each rank gives the row of its number; the last row is given by none."""
    rows = np.array([[comm.rank + 1.0, -1.0]])
    found = mpi.gather_by_index(comm, np.array([comm.rank]), rows, comm.size + 1)
    assert found[:-1, 0].tolist() == list(range(1, comm.size + 1))
    assert (found[:-1, 1] == -1).all()
    assert (found[-1] == 0).all()


def test_an_error_of_one_rank_is_raised_on_all(comm: MPI.Comm) -> None:
    mpi.raise_together(comm, None)
    last = comm.size - 1
    with pytest.raises(ValueError, match=f"rank {last}$"):
        mpi.raise_together(comm, ValueError(f"rank {last}") if comm.rank == last else None)
    with pytest.raises(ValueError, match="rank 0$"):
        mpi.raise_together(comm, ValueError(f"rank {comm.rank}"))


def test_first_rank_acts_for_all(comm: MPI.Comm) -> None:
    calls: list[int] = []

    def act() -> str:
        calls.append(comm.rank)
        return f"done on {comm.rank}"

    assert mpi.on_first_rank(comm, act) == "done on 0"
    assert calls == ([0] if comm.rank == 0 else [])

    def fail() -> None:
        raise OSError("no space")

    with pytest.raises(OSError, match="no space"):
        mpi.on_first_rank(comm, fail)


def test_warnings_come_from_one_rank(comm: MPI.Comm) -> None:
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        mpi.warn_together(comm, "odd", TorosWarning)
    assert len(found) == (1 if comm.rank == 0 else 0)


def test_warnings_point_at_the_code_of_the_user(alone: MPI.Comm) -> None:
    """However deep in the package they arise."""
    skin = tf.sew(alone, tf.meshes.cylinder(alone, 0.04, 0.02, 7e-3, mesh="structured"))
    with pytest.warns(TorosWarning) as found:
        make_filter("cone", skin, 9e-3)
    assert found[0].filename == __file__


class EndedError(Exception):
    """What stands for the end of the program."""


class Lone:
    """Two ranks, of which the other one never arrives."""

    size = 2

    def __init__(self) -> None:
        self.codes: list[int] = []

    def Dup(self) -> "Lone":  # noqa: N802
        return self

    def Ibarrier(self) -> "Lone":  # noqa: N802
        return self

    def Test(self) -> bool:  # noqa: N802
        return False

    def Abort(self, code: int) -> None:  # noqa: N802
        self.codes.append(code)
        raise EndedError


def test_warnings_are_heard_after_ffcx(alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """FFCx sends them to a logger: they come back where nobody listens to it, and only there."""
    heard: list[str] = []

    class Ear(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            heard.append(record.getMessage())

    monkeypatch.setattr(logging.root, "handlers", [])
    logger = logging.getLogger("py.warnings")
    monkeypatch.setattr(logger, "handlers", [logging.NullHandler()])

    def shown(text: str) -> list[str]:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            logging.captureWarnings(True)
            warn_together(alone, text, TorosWarning)
            logging.captureWarnings(False)
        return [str(warning.message) for warning in found]

    assert shown("nobody listens") == ["nobody listens"]
    monkeypatch.setattr(logger, "handlers", [Ear()])
    assert not shown("a handler listens")
    assert len(heard) == 1
    assert "a handler listens" in heard[0]


def test_an_error_of_one_rank_alone_ends_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error is told before the end, not after it."""
    monkeypatch.setattr(mpi, "PATIENCE", 0.05)
    told: list[Exception] = []
    lone = Lone()
    with pytest.raises(EndedError), mpi.ending_together(lone, told.append):  # type: ignore[arg-type]
        raise ValueError("alone")
    assert [str(error) for error in told] == ["alone"]
    assert lone.codes == [1]


def test_an_error_of_all_ranks_passes(comm: MPI.Comm) -> None:
    told: list[Exception] = []
    with pytest.raises(ValueError, match="all"), mpi.ending_together(comm, told.append):
        raise ValueError("all")
    with mpi.ending_together(comm, told.append):
        pass
    assert not told
