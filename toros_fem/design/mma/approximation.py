"""MMA's convex separable approximations, evaluated in blocks that fit into the cache."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import sum_over_ranks

BLOCK = 16384  # variables at a time, so that the work arrays fit into the cache
TINY = float(np.finfo(np.float64).tiny)
MIXED = 1.002  # 1.001 + 0.001, the fractions of a gradient in pⱼ and qⱼ


def cache_blocks(count: int) -> Iterator[slice]:
    """Return the slices that divide a number of variables into blocks."""
    return (slice(k, min(k + BLOCK, count)) for k in range(0, count, BLOCK))


@dataclass(frozen=True)
class DualEvaluation:
    """Approximations at the minimum of the Lagrangian over x.

    Attributes:
        change: f̃ᵢ(x) − fᵢ(xᵏ), the objective first.
        hessian: −∂²/∂λ² of the Lagrangian's minimum over x, for the constraints.
    """

    change: Floats
    hessian: Floats


class Approximation:
    """Approximations f̃ᵢ of fᵢ around xᵏ (Svanberg 2007, eqs. 3.2-3.8, section 4).

    Both asymptotes have the same distance from xᵏⱼ, Lⱼ = xᵏⱼ − dⱼ and Uⱼ = xᵏⱼ + dⱼ: they start so,
    and one factor moves both (eqs. 3.11, 3.12). In tⱼ = (xⱼ − xᵏⱼ)/dⱼ the approximations are

        f̃ᵢ(x) − fᵢ(xᵏ) = Σⱼ (hᵢⱼ tⱼ + aᵢⱼ tⱼ²) / (1 − tⱼ²),
        hᵢⱼ = dⱼ ∂fᵢ/∂xⱼ,  aᵢⱼ = 1.002 |hᵢⱼ| + ρᵢ wⱼ,  wⱼ = 2 dⱼ / (x̄ⱼ − x̲ⱼ).

    The change is summed directly, without the cancellation in Σ p/(U−x) + q/(x−L) − r. Weighted by
    multipliers, h = Σ λᵢhᵢ and a = Σ λᵢaᵢ (λ₀ = 1), the minimum over x is at
    t = −h/(a + √(a² − h²)), clipped; there ∂²/∂t² = 2a/((1 + t²)(1 − t²)).

    Args:
        comm: Communicator over which the variables are distributed.
        variables: Number of owned variables.
        constraints: Number of constraints.

    Attributes:
        curvature: ρᵢ, the objective first.
        size: Σⱼ |hᵢⱼ| over all ranks, the largest first-order change of fᵢ.
        total_weight: Σⱼ wⱼ over all ranks.
    """

    def __init__(self, comm: MPI.Comm, variables: int, constraints: int) -> None:
        self._comm = comm
        self._n, self._m = variables, constraints
        self._slope = np.empty((constraints + 1, variables))
        self._weight, self._low, self._high = np.empty((3, variables))
        self.curvature: Floats = np.zeros(constraints + 1)
        self.size: Floats = np.zeros(constraints + 1)
        self.total_weight = 0.0

    def expand(
        self,
        x: Floats,
        distance: Floats,
        bounds: tuple[Floats, Floats],
        move: float | Floats,
        gradients: Sequence[Floats],
    ) -> None:
        """Set xᵏ, dⱼ and the gradients there (collective).

        The box of t is given by the bounds, the move limit, and 0.9 of the distance to the
        asymptotes. A variable without range keeps its value: its slope is 0 and its box empty.

        Args:
            x, distance: xᵏ and dⱼ.
            bounds: x̲ and x̄.
            move: Move limit over the range, one for all variables or one for each.
            gradients: ∇fᵢ(xᵏ), the objective's first.
        """
        sums: Floats = np.zeros(self._m + 2)
        for part in cache_blocks(self._n):
            here, d = x[part], distance[part]
            lower, upper = bounds[0][part], bounds[1][part]
            slope, weight = self._slope[:, part], self._weight[part]
            for row, gradient in zip(slope, gradients, strict=True):
                np.multiply(gradient[part], d, out=row)
            span = np.maximum(upper - lower, TINY)
            inverse = 1 / np.maximum(d, TINY)
            limit = span * inverse
            np.divide(2.0, limit, out=weight)
            limit *= move if isinstance(move, float) else move[part]
            np.minimum(limit, 0.9, out=limit)
            low, high = self._low[part], self._high[part]
            np.multiply(np.subtract(lower, here, out=low), inverse, out=low)
            np.multiply(np.subtract(upper, here, out=high), inverse, out=high)
            np.minimum(high, limit, out=high)
            np.maximum(low, np.negative(limit, out=limit), out=low)
            sums[:-1] += np.abs(slope) @ np.ones(len(d))
            sums[-1] += weight[upper > lower].sum()  # what cannot move has no part in the mean
        sums = sum_over_ranks(self._comm, sums)
        self.size, self.total_weight = sums[:-1], float(sums[-1])

    def evaluate_dual(self, multipliers: Floats) -> DualEvaluation:
        """Evaluate the approximations at the minimum of the Lagrangian over x (collective)."""
        m = self._m
        changes, products = np.zeros(2 * m + 3), np.zeros((m + 1, m + 1))
        work = np.empty((2, m + 1, BLOCK))
        for part in cache_blocks(self._n):
            slope, weight = self._slope[:, part], self._weight[part]
            steep = np.abs(slope)
            t, a, free = self._stationary(multipliers, part, steep)
            square = t * t
            s = 1 / (1 - square)
            self._add_changes(changes, part, steep, t, square, s)
            # Row i: ∂f̃ᵢ/∂t (1 − t²)² for ρ = 0; the last one: its derivative by ρ.
            square += 1
            a *= 2
            root = np.sqrt(square * s / a)  # (1 − t²)⁻² times the root of 1/∂²φ/∂t²
            root *= s
            root = np.where(free, root, 0.0)
            square *= root
            t *= root
            t *= 2
            rows, copy = work[0, :, : len(t)], work[1, :, : len(t)]
            np.multiply(weight, t, out=rows[-1])
            t *= MIXED
            np.multiply(slope[1:], square, out=rows[:-1])
            steep[1:] *= t
            rows[:-1] += steep[1:]
            copy[:] = rows  # numpy is slower for a product of a matrix with itself
            products += rows @ copy.T
        sums = sum_over_ranks(self._comm, np.concatenate([changes, products.ravel()]))
        spread = np.hstack([np.eye(m), self.curvature[1:, None]])
        hessian = spread @ sums[2 * m + 3 :].reshape(m + 1, m + 1) @ spread.T
        return DualEvaluation(self._assemble(sums[: 2 * m + 3]), hessian)

    def write_minimizer(
        self,
        multipliers: Floats,
        x: Floats,
        distance: Floats,
        bounds: tuple[Floats, Floats],
        out: Floats,
    ) -> None:
        """Write the minimum of the Lagrangian over x to `out`."""
        for part in cache_blocks(self._n):
            steep = np.abs(self._slope[:, part])
            t = self._stationary(multipliers, part, steep)[0]
            t *= distance[part]
            t += x[part]
            np.maximum(t, bounds[0][part], out=t)  # rounding may exceed the bound
            np.minimum(t, bounds[1][part], out=out[part])

    def change_at(self, x: Floats, distance: Floats, trial: Floats) -> tuple[Floats, float]:
        """Return f̃ᵢ(trial) − fᵢ(xᵏ), and ∂f̃ᵢ/∂ρᵢ there, GCMMA's d (collective)."""
        changes = np.zeros(2 * self._m + 3)
        for part in cache_blocks(self._n):
            t = (trial[part] - x[part]) / np.maximum(distance[part], TINY)
            square = t * t
            steep = np.abs(self._slope[:, part])
            self._add_changes(changes, part, steep, t, square, 1 / (1 - square))
        sums = sum_over_ranks(self._comm, changes)
        return self._assemble(sums), float(sums[-1])

    def _stationary(
        self, multipliers: Floats, part: slice, steep: Floats
    ) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
        """Return t at the minimum of the Lagrangian, a, and whether t is inside its box."""
        weights = np.concatenate([[1.0], multipliers])
        h = weights @ self._slope[:, part]
        a = (MIXED * weights) @ steep
        a += float(weights @ self.curvature) * self._weight[part]
        t = a - h
        t *= a + h
        np.sqrt(t, out=t)
        t += a
        np.divide(np.negative(h, out=h), t, out=t)
        inside = np.maximum(t, self._low[part], out=h)  # three times as fast as numpy's clip
        np.minimum(inside, self._high[part], out=inside)
        return inside, a, inside == t

    def _add_changes(
        self, changes: Floats, part: slice, steep: Floats, t: Floats, square: Floats, s: Floats
    ) -> None:
        m = self._m
        changes[: m + 1] += self._slope[:, part] @ (t * s)
        bent = square * s
        changes[m + 1 : -1] += steep @ bent
        changes[-1] += self._weight[part] @ bent

    def _assemble(self, sums: Floats) -> Floats:
        m = self._m
        return np.asarray(sums[: m + 1] + MIXED * sums[m + 1 : -1] + self.curvature * sums[-1])
