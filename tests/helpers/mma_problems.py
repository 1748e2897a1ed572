"""Optimisation problems with known solutions."""

from collections.abc import Callable

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

Problem = Callable[[np.ndarray], tuple[float, np.ndarray, list[float], list[np.ndarray]]]


def vec(values: np.ndarray, comm: MPI.Comm = MPI.COMM_SELF) -> PETSc.Vec:
    return PETSc.Vec().createWithArray(np.array(values, dtype=float), comm=comm)


def beam(x: np.ndarray) -> tuple[float, np.ndarray, list[float], list[np.ndarray]]:
    """Svanberg 1987: the cantilever of five box sections."""
    c = np.array([61.0, 37, 19, 7, 1])
    return 0.0624 * x.sum(), np.full(5, 0.0624), [float((c / x**3).sum() - 1)], [-3 * c / x**4]
