"""Krylov methods with the factors of a neighbouring tangent as preconditioner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import norm, sum_over_ranks


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


def gmres(
    comm: MPI.Comm,
    multiply: Callable[[Floats], Floats],
    precondition: Callable[[Floats], Floats],
    rhs: Floats,
    tolerance: float,
    max_iterations: int,
) -> tuple[Floats, float]:
    """Solve J x = rhs for a matrix J without symmetry by GMRES (collective).

    Preconditioned from the right, so that the residual is the true one (Saad & Schultz 1986; Saad
    2003, section 9.3.2). All directions are kept: a good preconditioner needs few.

    Args:
        comm: Communicator over which the vectors are distributed.
        multiply: Product with J.
        precondition: Product with the inverse of a matrix near J.
        rhs: Right-hand side, owned unknowns.
        tolerance: Norm of the residual over that of `rhs` at which it ends.
        max_iterations: Largest number of iterations, each with one product and one solve.

    Returns:
        The solution, and the norm of its residual over that of `rhs`.
    """
    size = norm(comm, rhs)
    if not size > 0:
        return np.zeros_like(rhs), 0.0
    basis: list[Floats] = [np.asarray(rhs / size)]
    directions: list[Floats] = []
    hessenberg: Floats = np.zeros((max_iterations + 1, max_iterations))
    weights, left = np.zeros(0), 1.0
    for count in range(max_iterations):
        directions.append(precondition(basis[-1]))
        new, known = multiply(directions[-1]), np.stack(basis)
        for _ in range(2):  # once more, against rounding
            parts = sum_over_ranks(comm, np.asarray(known @ new))
            hessenberg[: count + 1, count] += parts
            new = new - parts @ known
        length = norm(comm, new)
        hessenberg[count + 1, count] = length
        goal = np.eye(count + 2)[0] * size
        square = hessenberg[: count + 2, : count + 1]
        weights = np.linalg.lstsq(square, goal, rcond=None)[0]
        left = float(np.linalg.norm(goal - square @ weights)) / size
        if left <= tolerance or not length > 1e-14 * np.abs(hessenberg[: count + 1, count]).max():
            break
        basis.append(np.asarray(new / length))
    return np.asarray(weights @ np.array(directions)), left
