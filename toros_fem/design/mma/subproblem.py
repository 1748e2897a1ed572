"""MMA's subproblem, solved by its dual with one unknown per constraint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.design.mma.approximation import TINY, Approximation

STEPS = 100  # limit for unforeseen input; far more than ever needed
GROWTH = 10.0  # of a multiplier in one step, where the curvature does not limit it
EPSILON = np.finfo(np.float64).eps
FORCING = 0.1  # largest final residual over that of the starting multipliers
ROUNDING = 1e-13  # residual that rounding may leave: nothing smaller is requested
SHIFT = 1e-3  # of the Hessian, times the residual: it keeps the convergence superlinear


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

    Args:
        model: The approximations.
        values: fᵢ(xᵏ).
        penalty: cᵢ and dᵢ.
        start: Multipliers to start from; None for a guess.
        tolerance: Largest residual maxᵢ |min(λᵢ/uᵢ, −∂W/∂λᵢ / sᵢ)| with sᵢ = |fᵢ| + Σⱼ|hᵢⱼ|
            and uᵢ the multiplier that balances objective and constraint. The residual must also
            fall to a tenth of that at the starting multipliers, down to 1e-13.
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
    found = model.evaluate_dual(multipliers)
    y = penalty.violation(multipliers)
    there = values + found.change[1:]
    terms = np.concatenate(
        [found.change[:1], multipliers * there, -0.5 * penalty.quadratic * y * y]
    )
    return _Point(
        multipliers,
        float(terms.sum()),
        float(np.abs(terms).sum() + multipliers @ (np.abs(values) + model.size[1:])),
        there - y,
        found.hessian,
    )


def _residual(point: _Point, penalty: Penalty, unit: Floats, size: Floats) -> float:
    # y = (λ − c)/d is as inexact as the rounding of λ.
    rounding = 4 * EPSILON * point.multipliers / penalty.quadratic
    rounding = np.where(point.multipliers >= penalty.linear, rounding, 0.0)
    slope = point.slope - np.clip(point.slope, -rounding, rounding)
    return float(np.abs(np.minimum(point.multipliers / unit, -slope / size)).max())


def _newton(point: _Point, penalty: Penalty, shift: Floats) -> Floats:
    """Return the step to the maximum over λ ≥ 0 of a quadratic model of W with exact y(λ)."""
    lam = point.multipliers
    excess = (lam - penalty.linear) / penalty.quadratic
    active = excess > 0
    step: Floats = np.zeros(len(lam))
    for attempt in range(2 * len(lam) + 10):  # the set of yᵢ > 0 is found in a few rounds
        # With all variables at bounds, or dependent constraints, the Hessian of W is singular.
        hessian = point.hessian + np.diag(shift + active / penalty.quadratic)
        # The slope where yᵢ stays (λᵢ − cᵢ)/dᵢ in the active set, and 0 outside.
        slope = point.slope + np.maximum(excess, 0.0) - np.where(active, excess, 0.0)
        step = _above(hessian, slope, -lam)
        again = excess + step / penalty.quadratic > 0
        if np.array_equal(again, active):
            break
        active = again | active if attempt > len(lam) else again  # avoid cycling
    return step


def _above(hessian: Floats, slope: Floats, floor: Floats) -> Floats:
    """Return the maximum of slope·z − ½ z·H z over z ≥ floor, floor ≤ 0."""
    scale = 1 / np.sqrt(np.diag(hessian))
    scaled = scale[:, None] * hessian * scale + 1e-12 * np.eye(len(slope))
    step = scale * np.linalg.solve(scaled, scale * slope)
    if np.all(step >= floor):
        return np.asarray(step)
    target = scale * slope - scaled @ (floor / scale)
    return np.asarray(scale * _nonnegative(scaled, target) + floor)


def _nonnegative(hessian: Floats, slope: Floats) -> Floats:
    """Return the maximum of slope·u − ½ u·H u over u ≥ 0, by Lawson and Hanson's active sets.

    scipy.optimize.nnls has the same algorithm, but some versions stop at wrong sets.
    """
    u, free = np.zeros(len(slope)), np.zeros(len(slope), dtype=bool)
    for _ in range(10 * len(slope)):
        pull = np.where(free, -np.inf, slope - hessian @ u)
        new = int(np.argmax(pull))
        if pull[new] <= 0:
            break
        free[new] = True
        while free.any():
            trial = np.zeros(len(slope))
            trial[free] = np.linalg.solve(hessian[np.ix_(free, free)], slope[free])
            out = np.flatnonzero(free & (trial <= 0))
            if len(out) == 0:
                u = trial
                break
            gap = u[out] - trial[out]
            ratio = np.divide(u[out], gap, out=np.zeros(len(out)), where=gap > 0)
            u += ratio.min() * (trial - u)
            free[out[ratio <= ratio.min()]] = False
            u[~free] = 0.0
        if not free[new]:  # it entered by rounding
            break
    return u


def _better(old: _Point, new: _Point, length: float, before: float, after: float) -> bool:
    """Return whether to accept a step along which W's slope goes from `before` to `after`."""
    if after >= 0:  # W is concave, so it increases along the whole step
        return True
    if length * max(before, -after) <= 1e-12 * (old.magnitude + new.magnitude):
        return -after <= 0.5 * before  # the change of W is below rounding
    return new.value - old.value >= 1e-4 * length * before
