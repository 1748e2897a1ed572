"""Reductions, gathers, errors that all ranks raise together, and numbers that all runs share."""

from __future__ import annotations

import functools
import gc
import logging
import os
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.validation import Floats, require_kind

# Time in s that a rank with an error waits for the others before it ends them all.
PATIENCE = 10.0
# Folders of the package: warnings point at the code that calls it.
_PACKAGE = Path(__file__).parents[1]
OWN = (f"{_PACKAGE}{os.sep}", f"{_PACKAGE.parent / 'meshes'}{os.sep}")
T = TypeVar("T")
R = TypeVar("R")
P = ParamSpec("P")


def total(comm: MPI.Comm, value: float) -> float:
    """Return the sum of a number over the ranks."""
    return float(comm.allreduce(float(value), op=MPI.SUM))


def sum_over_ranks(comm: MPI.Comm, local: Floats) -> Floats:
    """Return the entrywise sum of small arrays over the ranks."""
    out = np.empty_like(local)
    comm.Allreduce(np.ascontiguousarray(local), out)
    return out


def largest(comm: MPI.Comm, value: float) -> float:
    """Return the maximum of a number over the ranks."""
    return float(comm.allreduce(float(value), op=MPI.MAX))


def smallest(comm: MPI.Comm, value: float) -> float:
    """Return the minimum of a number over the ranks."""
    return float(comm.allreduce(float(value), op=MPI.MIN))


def dot(comm: MPI.Comm, a: Floats, b: Floats) -> float:
    """Return the inner product of two vectors given by their owned entries."""
    return total(comm, float(np.vdot(a, b)))


def norm(comm: MPI.Comm, owned: Floats) -> float:
    """Return the Euclidean norm of a vector given by its owned entries."""
    return float(np.sqrt(dot(comm, owned, owned)))


def raise_together(comm: MPI.Comm, error: Exception | None) -> None:
    """Raise on every rank the error of the lowest rank that has one (collective)."""
    errors = comm.allgather(error)
    for found in errors:
        if found is not None:
            raise found


@contextmanager
def together(comm: MPI.Comm) -> Iterator[None]:
    """Let all ranks raise what one of them raises in the block (collective at its end).

    The block itself has no collective call: the others would wait there.
    """
    error = None
    try:
        yield
    except Exception as caught:  # raised on all ranks, so that none waits
        error = caught
    raise_together(comm, error)


def on_first_rank(comm: MPI.Comm, action: Callable[[], T]) -> T:
    """Run an action on the first rank; return its result or raise its error on all (collective)."""
    require_comm(comm)
    result = None
    with together(comm):
        if comm.rank == 0:
            result = action()
    found: T = comm.bcast(result, root=0)
    return found


class OnFirst(Generic[T]):
    """A serial object on the first rank, which all ranks ask together (collective).

    Errors of the object reach all ranks.
    """

    def __init__(self, comm: MPI.Comm, make: Callable[[], T]) -> None:
        self._comm, self._made = comm, list[T]()
        on_first_rank(comm, lambda: self._made.append(make()))

    def __call__(self, ask: Callable[[T], R]) -> R:
        """Return on all ranks what the object answers."""
        return on_first_rank(self._comm, lambda: ask(self._made[0]))

    def alone(self, ask: Callable[[T], R], other: R) -> R:
        """Return what the object answers on the first rank, and `other` on the others."""
        answers = [other]
        self(lambda made: answers.append(ask(made)))
        return answers[-1]


def require_comm(comm: Any) -> None:
    """Check that a value is a communicator."""
    require_kind("comm", comm, MPI.Comm, "an MPI communicator, one of mpi4py.MPI")


def on_root(entry: Callable[P, T]) -> Callable[P, T]:
    """Decorate an entry that all ranks call, and that the first rank of its `comm` alone runs.

    Its arguments are those of the first rank; all ranks return the same and raise the same.
    """

    @functools.wraps(entry)
    def shared(*args: P.args, **kwargs: P.kwargs) -> T:
        comm: Any = kwargs.get("comm", args[0] if args else None)
        return on_first_rank(comm, lambda: entry(*args, **kwargs))

    return shared


def warn_together(comm: MPI.Comm, message: str, kind: type[Warning]) -> None:
    """Warn on the first rank, at the line of the user's code (collective).

    Where Python's filters make errors of such warnings, all ranks raise it.
    """

    def warn() -> None:
        _give_warnings_back()
        warnings.warn(message, kind, skip_file_prefixes=OWN)

    on_first_rank(comm, warn)


def _give_warnings_back() -> None:
    """Let Python show warnings again: FFCx sends them to a logger, where nobody may listen."""
    listening = [logging.root, logging.getLogger("py.warnings")]
    heard = [h for of in listening for h in of.handlers if not isinstance(h, logging.NullHandler)]
    if not heard:
        logging.captureWarnings(False)


@contextmanager
def ending_together(comm: MPI.Comm, tell: Callable[[Exception], None]) -> Iterator[None]:
    """End all ranks where one leaves the block by an error that the others do not share.

    Errors that all ranks raise pass through. `tell` prints an error of some alone, which after
    `PATIENCE` ends the program, since the others wait for these ranks.
    """
    if comm.size == 1:
        yield
        return
    own = comm.Dup()  # what is under way on the other one does not matter here
    try:
        yield
    except Exception as error:
        request, begin = own.Ibarrier(), time.monotonic()
        while not request.Test():
            if time.monotonic() - begin > PATIENCE:
                tell(error)
                own.Abort(1)
            time.sleep(0.01)
        own.Free()
        raise
    own.Ibarrier().Wait()
    own.Free()


def gather_by_index(
    comm: MPI.Comm, index: npt.NDArray[np.int64], values: Floats, size: int
) -> Floats:
    """Assemble an array of `size` rows on every rank from (global index, row) pairs.

    Rows that several ranks give must be equal; rows that none gives are zero.
    """
    values = np.ascontiguousarray(values, dtype=np.float64)
    out = np.zeros((size, *values.shape[1:]))
    for rows, part in zip(comm.allgather(index), comm.allgather(values), strict=True):
        out[rows] = part
    return out


def free_dropped(comm: MPI.Comm) -> None:
    """Free problems that were dropped (collective).

    Their parts refer to each other, and their factors are large. PETSc keeps distributed objects
    until all ranks have dropped them and meet here.
    """
    from petsc4py import PETSc  # what only reads files and help does without

    gc.collect()
    PETSc.garbage_cleanup(comm)
    gc.collect()  # what these objects held


# --------------------------------------------------------------------------------------- rounding


def rounded(values: Floats, unit: float | Floats) -> Floats:
    """Return the nearest multiples of a unit, which a step hands on; values stay where it is 0.

    Runs on other kernels, or on another number of ranks, differ by 1e-12 after one step of a
    design. The next step may amplify that tenfold, or without limit where it asks for a sign. Where
    a step hands on rounded numbers, these are the same in all runs, and so is all that follows.
    """
    by = np.where(np.asarray(unit) > 0, unit, 1.0)
    return np.where(np.asarray(unit) > 0, np.round(values / by) * by, values)
