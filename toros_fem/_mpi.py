"""Reductions, gathers, and errors that all ranks raise together."""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem._types import Floats

T = TypeVar("T")


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


def on_first_rank(comm: MPI.Comm, action: Callable[[], T]) -> T:
    """Run an action on the first rank; return its result or raise its error on all (collective)."""
    result, error = None, None
    if comm.rank == 0:
        try:
            result = action()
        except Exception as caught:  # raised on all ranks, so that none waits
            error = caught
    raise_together(comm, error)
    found: T = comm.bcast(result, root=0)
    return found


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
    gc.collect()
    PETSc.garbage_cleanup(comm)
    gc.collect()  # what these objects held
