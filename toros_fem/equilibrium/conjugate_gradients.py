"""Conjugate gradients with the factors of a neighbouring tangent as preconditioner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem._mpi import sum_over_ranks
from toros_fem._types import Floats


@dataclass(frozen=True, eq=False)
class CGResult:
    """Result of conjugate gradients.

    Attributes:
        solution: The last iterate, owned unknowns.
        residual: Norm of its residual over that of the right-hand side.
        iterations: Number of iterations, each with one product and one solve.
        positive: Whether no direction of negative curvature was met.
    """

    solution: Floats
    residual: float
    iterations: int
    positive: bool


def conjugate_gradients(
    comm: MPI.Comm,
    multiply: Callable[[Floats], Floats],
    precondition: Callable[[Floats], Floats],
    rhs: Floats,
    tolerance: float,
    max_iterations: int,
) -> CGResult:
    """Solve K x = rhs approximately by preconditioned conjugate gradients (collective).

    The iteration ends at the tolerance, at the limit, or where K or the preconditioner has no
    positive curvature; the last iterate before that is returned.

    Args:
        comm: Communicator over which the vectors are distributed.
        multiply: Product with the symmetric K.
        precondition: Product with the inverse of a symmetric positive definite matrix near K.
        rhs: Right-hand side, owned unknowns.
        tolerance: Norm of the residual over that of `rhs` at which it ends.
        max_iterations: Largest number of iterations.
    """
    x = np.zeros_like(rhs)
    r = rhs.copy()
    z = precondition(r)
    rz, rr = sum_over_ranks(comm, np.array([r @ z, r @ r]))
    if not rr > 0:
        return CGResult(x, 0.0, 0, True)
    first, p = rr, z.copy()
    for count in range(1, max_iterations + 1):
        q = multiply(p)
        (curvature,) = sum_over_ranks(comm, np.array([p @ q]))
        if not (curvature > 0 and rz > 0):
            return CGResult(x, float(np.sqrt(rr / first)), count, False)
        alpha = rz / curvature
        x += alpha * p
        r -= alpha * q
        (rr,) = sum_over_ranks(comm, np.array([r @ r]))
        if rr <= tolerance**2 * first or count == max_iterations:
            break
        z = precondition(r)
        before = rz
        (rz,) = sum_over_ranks(comm, np.array([r @ z]))
        p *= rz / before
        p += z
    return CGResult(x, float(np.sqrt(rr / first)), count, True)
