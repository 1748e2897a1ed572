"""MMA's convex separable approximations, and its subproblem, solved by its dual."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.mpi import sum_over_ranks
from toros_fem.base.validation import Bools, Floats

BLOCK = 16384  # variables at a time, so that the work arrays fit into the cache
TINY = float(np.finfo(np.float64).tiny)
MIXED = 1.002  # 1.001 + 0.001, the fractions of a gradient in pⱼ and qⱼ
STEPS = 100  # limit for unforeseen input; far more than ever needed
GROWTH = 10.0  # of a multiplier in one step, where the curvature does not limit it
EPSILON = np.finfo(np.float64).eps
FORCING = 0.1  # largest final residual over that of the starting multipliers
ROUNDING = 1e-13  # residual that rounding may leave: nothing smaller is requested
SHIFT = 1e-3  # of the Hessian, times the residual: it keeps the convergence superlinear
BLOCKS = 3  # exchanges of all wrong members in a row that may leave as many wrong


def cache_blocks(count: int) -> Iterator[slice]:
    """Return the slices that divide a number of variables into blocks."""
    return (slice(k, min(k + BLOCK, count)) for k in range(0, count, BLOCK))


class Approximation:
    """Approximations f̃ᵢ of fᵢ around xᵏ (Svanberg 2007, eqs. 3.2-3.8, section 4).

    Both asymptotes have the same distance from xᵏⱼ, Lⱼ = xᵏⱼ − dⱼ and Uⱼ = xᵏⱼ + dⱼ: they start so,
    and one factor moves both (eqs. 3.11, 3.12). In tⱼ = (xⱼ − xᵏⱼ)/dⱼ the approximations are

        f̃ᵢ(x) − fᵢ(xᵏ) = Σⱼ (hᵢⱼ tⱼ + aᵢⱼ tⱼ²) / (1 − tⱼ²),
        hᵢⱼ = dⱼ ∂fᵢ/∂xⱼ,  aᵢⱼ = 1.002 |hᵢⱼ| + ρᵢ wⱼ,  wⱼ = 2 dⱼ / (x̄ⱼ − x̲ⱼ).

    The change is summed directly, without the cancellation in Σ p/(U−x) + q/(x−L) − r. Weighted by
    multipliers, h = Σ λᵢhᵢ and a = Σ λᵢaᵢ (λ₀ = 1), the minimum over x is at
    t = −h/(a + √(a² − h²)), clipped; there ∂²/∂t² = 2a/((1 + t²)(1 − t²)).

    The box of t is given by the bounds, the move limit, and 0.9 of the distance to the asymptotes.
    A variable without range keeps its value: its slope is 0 and its box empty.

    Args:
        comm: Communicator over which the variables are distributed.
        x, distance: xᵏ and dⱼ of the owned variables.
        bounds: x̲ and x̄.
        move: Move limit over the range, one for all variables or one for each.
        gradients: ∇fᵢ(xᵏ), the objective's first.

    Attributes:
        curvature: ρᵢ, the objective first.
        size: Σⱼ |hᵢⱼ| over all ranks, the largest first-order change of fᵢ.
        total_weight: Σⱼ wⱼ over all ranks.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        x: Floats,
        distance: Floats,
        bounds: tuple[Floats, Floats],
        move: float | Floats,
        gradients: Sequence[Floats],
    ) -> None:
        self._comm, self._x, self._bounds = comm, x, bounds
        self._distance = np.maximum(distance, TINY)
        (lower, upper), d = bounds, self._distance
        span = np.maximum(upper - lower, TINY)
        self._slope = np.array(gradients) * distance
        self._steep = np.abs(self._slope)
        self._weight = 2 * d / span
        limit = np.minimum(move * span / d, 0.9)
        self._low = np.maximum((lower - x) / d, -limit)
        self._high = np.minimum((upper - x) / d, limit)
        weight = self._weight[upper > lower].sum()  # what cannot move has no part in the mean
        sums = sum_over_ranks(comm, np.append(self._steep.sum(axis=1), weight))
        self.size, self.total_weight = sums[:-1], float(sums[-1])
        self.curvature: Floats = np.zeros(len(self.size))

    def evaluate_dual(self, multipliers: Floats) -> tuple[Floats, Floats]:
        """Return f̃ᵢ(x) − fᵢ(xᵏ) at the minimum of the Lagrangian over x, the objective first.

        Also −∂²/∂λ² of this minimum, for the constraints (collective).
        """
        m = len(self.size) - 1
        sums: Floats = np.zeros(m + 2 + (m + 1) ** 2)
        for part in cache_blocks(len(self._x)):
            t, a, free = self._minimum(multipliers, part)
            square = t * t
            # (1 − t²)⁻² times the root of 1/∂²φ/∂t²
            root = np.sqrt((1 + square) / (2 * a * (1 - square))) / (1 - square)
            by_slope = (1 + square) * self._slope[1:, part]
            by_steep = 2 * MIXED * t * self._steep[1:, part]
            # Row i: ∂f̃ᵢ/∂t (1 − t²)² for ρ = 0; the last one: its derivative by ρ.
            rows = np.vstack([by_slope + by_steep, 2 * t * self._weight[part]])
            rows *= np.where(free, root, 0.0)
            # The copy: numpy is slower for a product of a matrix with itself.
            products = rows @ rows.copy().T
            sums += np.append(self._changes(t, part), products)
        sums = sum_over_ranks(self._comm, sums)
        spread = np.hstack([np.eye(m), self.curvature[1:, None]])
        hessian = spread @ sums[m + 2 :].reshape(m + 1, m + 1) @ spread.T
        return self._whole(sums[: m + 2]), hessian

    def minimizer(self, multipliers: Floats) -> Floats:
        """Return the owned x at the minimum of the Lagrangian."""
        t, _, _ = self._minimum(multipliers, slice(None))
        # Rounding may exceed the bound.
        return np.clip(self._x + self._distance * t, *self._bounds)

    def change_at(self, trial: Floats) -> tuple[Floats, float]:
        """Return f̃ᵢ(trial) − fᵢ(xᵏ), and ∂f̃ᵢ/∂ρᵢ there, GCMMA's d (collective)."""
        t = (trial - self._x) / self._distance
        sums = sum_over_ranks(self._comm, self._changes(t, slice(None)))
        return self._whole(sums), float(sums[-1])

    def _minimum(
        self, multipliers: Floats, part: slice
    ) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
        """Return t at the minimum of the Lagrangian, a, and whether t is inside its box."""
        weights = np.append(1.0, multipliers)
        h = weights @ self._slope[:, part]
        a = (MIXED * weights) @ self._steep[:, part]
        a += float(weights @ self.curvature) * self._weight[part]
        t = -h / (a + np.sqrt((a - h) * (a + h)))
        # Three times as fast as numpy's clip.
        inside = np.minimum(np.maximum(t, self._low[part]), self._high[part])
        return inside, a, inside == t

    def _changes(self, t: Floats, part: slice) -> Floats:
        """Return f̃ᵢ(t) − fᵢ(xᵏ) for ρ = 0, and its derivative by ρ, of some variables."""
        s = 1 / (1 - t * t)
        bent = t * t * s
        change = self._slope[:, part] @ (t * s) + MIXED * (self._steep[:, part] @ bent)
        return np.append(change, self._weight[part] @ bent)

    def _whole(self, sums: Floats) -> Floats:
        return np.asarray(sums[:-1] + self.curvature * sums[-1])


@dataclass(frozen=True)
class Penalty:
    """Penalty cᵢyᵢ + ½dᵢyᵢ² for violating each constraint by yᵢ.

    Attributes:
        linear, quadratic: cᵢ ≥ 0 and dᵢ > 0.
    """

    linear: Floats
    quadratic: Floats

    def violation(self, multipliers: Floats) -> Floats:
        """Return the yᵢ at which the derivative of the penalty is λᵢ."""
        return np.asarray(np.maximum(multipliers - self.linear, 0.0) / self.quadratic)


@dataclass(frozen=True)
class Solution:
    """Solution of a subproblem.

    Attributes:
        multipliers: λᵢ.
        residual: Residual of the optimality conditions, defined in `solve_subproblem`.
        evaluations: Number of passes over all variables.
    """

    multipliers: Floats
    residual: float
    evaluations: int


@dataclass(frozen=True)
class _Point:
    """The dual W at some multipliers, its slope, and its negative Hessian without the part of y."""

    multipliers: Floats
    value: float
    magnitude: float
    slope: Floats
    hessian: Floats


def solve_subproblem(
    model: Approximation, values: Floats, penalty: Penalty, start: Floats | None, tolerance: float
) -> Solution:
    """Return the multipliers of the subproblem (Svanberg 2007, eqs. 3.1, 5.1; collective).

    min f̃₀(x) + Σᵢ cᵢyᵢ + ½dᵢyᵢ² subject to f̃ᵢ(x) − yᵢ ≤ 0, x in its box, y ≥ 0: the artificial
    variables y make it solvable for all constraints. For given multipliers x and
    yᵢ = max(λᵢ − cᵢ, 0)/dᵢ have closed forms. The concave dual W(λ) remains to be maximised over
    λ ≥ 0. Its slope f̃(x(λ)) − y is continuous and piecewise smooth. Newton steps, each the solution
    of a quadratic problem with the same bounds, with a line search converge globally and fast
    (Pang & Qi, J. Optim. Theory Appl. 85, 1995). All decisions are made on reduced numbers, so the
    ranks agree.

    The tolerance is the largest residual maxᵢ |min(λᵢ/uᵢ, −∂W/∂λᵢ / sᵢ)| with sᵢ = |fᵢ| + Σⱼ|hᵢⱼ|
    and uᵢ the multiplier that balances objective and constraint. The residual must also fall to a
    tenth of that at the starting multipliers, down to 1e-13. Values are fᵢ(xᵏ); without multipliers
    to start from they are guessed.
    """
    count = 1
    if len(values) == 0:
        return Solution(np.zeros(0), 0.0, 0)
    bend = model.size + model.curvature * model.total_weight
    unit = np.maximum(bend[0], TINY) / np.maximum(bend[1:], TINY)
    unit = np.clip(unit, TINY, np.where(penalty.linear > 0, penalty.linear, np.inf))
    size = np.abs(values) + model.size[1:]
    size[size == 0] = 1.0
    point = _evaluate(model, values, penalty, unit if start is None else start)
    residual = _residual(point, penalty, unit, size)
    # Near the outer solution the last multipliers meet the tolerance as they are. If they were
    # kept, the iterates would drift off the constraints and stall.
    tolerance = max(min(tolerance, FORCING * residual), ROUNDING)
    for _ in range(STEPS):
        if residual <= tolerance:
            break
        ceiling = np.maximum(point.multipliers, unit)
        damping = SHIFT * min(1.0, residual)
        step = _newton(point, penalty, damping * (np.diag(point.hessian) + size / ceiling))
        length = 1 / max(1.0, float((step / (GROWTH * ceiling)).max()))
        before, shortest = float(point.slope @ step), 1e-10 * length
        while length > shortest and before > 0:
            trial = _evaluate(
                model, values, penalty, np.maximum(point.multipliers + length * step, 0.0)
            )
            count += 1
            after = float(trial.slope @ step)
            if _better(point, trial, length, before, after):
                break
            length *= min(max(before / (before - after), 0.1), 0.5)
        else:
            break  # no step improves the point beyond rounding
        point = trial
        residual = _residual(point, penalty, unit, size)
    return Solution(point.multipliers, residual, count)


def _evaluate(
    model: Approximation, values: Floats, penalty: Penalty, multipliers: Floats
) -> _Point:
    change, hessian = model.evaluate_dual(multipliers)
    y = penalty.violation(multipliers)
    there = values + change[1:]
    terms = np.concatenate([change[:1], multipliers * there, -0.5 * penalty.quadratic * y * y])
    return _Point(
        multipliers,
        float(terms.sum()),
        float(np.abs(terms).sum() + multipliers @ (np.abs(values) + model.size[1:])),
        there - y,
        hessian,
    )


def _residual(point: _Point, penalty: Penalty, unit: Floats, size: Floats) -> float:
    # y = (λ − c)/d is as inexact as the rounding of λ.
    rounding = 4 * EPSILON * point.multipliers / penalty.quadratic
    rounding = np.where(point.multipliers >= penalty.linear, rounding, 0.0)
    slope = point.slope - np.clip(point.slope, -rounding, rounding)
    return float(np.abs(np.minimum(point.multipliers / unit, -slope / size)).max())


def _newton(point: _Point, penalty: Penalty, shift: Floats) -> Floats:
    """Return the step to the maximum over λ ≥ 0 of a quadratic model of W with exact y(λ).

    Each λᵢ is held at 0 or free, and each yᵢ is (λᵢ − cᵢ)/dᵢ or 0. All members of these two sets
    that turn out wrong change sides, as long as their number falls; else only the last does, which
    comes to an end for every positive definite matrix (Júdice & Pires, Comput. Oper. Res. 21,
    1994).
    """
    lam, m = point.multipliers, len(point.multipliers)
    excess = (lam - penalty.linear) / penalty.quadratic
    free, active = np.ones(m, dtype=bool), excess > 0
    fewest, patience = 2 * m + 1, BLOCKS
    step: Floats = np.zeros(m)
    for _ in range(10 * m + 10):
        hessian = point.hessian + np.diag(shift + active / penalty.quadratic)
        slope = point.slope + np.maximum(excess, 0.0) - np.where(active, excess, 0.0)
        step = _held(hessian, slope, -lam, free)
        pull = slope - hessian @ step
        wrong_side = np.where(free, step < -lam, pull > 0)
        wrong = np.append(wrong_side, active != (excess + step / penalty.quadratic > 0))
        count = int(np.count_nonzero(wrong))
        if count == 0:
            break
        if count < fewest:
            fewest, patience = count, BLOCKS
        elif patience:
            patience -= 1
        else:
            wrong = np.arange(2 * m) == np.flatnonzero(wrong)[-1]
        free, active = free ^ wrong[:m], active ^ wrong[m:]
    return step


def _held(hessian: Floats, slope: Floats, floor: Floats, free: Bools) -> Floats:
    """Return the maximum of slope·z − ½ z·H z where all z but the free ones are at the floor."""
    # With all variables at bounds, or dependent constraints, the Hessian of W is singular.
    scale = 1 / np.sqrt(np.diag(hessian))
    scaled = scale[:, None] * hessian * scale + 1e-12 * np.eye(len(slope))
    step = np.where(free, 0.0, floor / scale)
    right = scale * slope - scaled @ step
    step[free] = np.linalg.solve(scaled[np.ix_(free, free)], right[free])
    return np.where(free, scale * step, floor)


def _better(old: _Point, new: _Point, length: float, before: float, after: float) -> bool:
    """Return whether to accept a step along which W's slope goes from `before` to `after`."""
    if after >= 0:  # W is concave, so it increases along the whole step
        return True
    if length * max(before, -after) <= 1e-12 * (old.magnitude + new.magnitude):
        return -after <= 0.5 * before  # the change of W is below rounding
    return new.value - old.value >= 1e-4 * length * before
