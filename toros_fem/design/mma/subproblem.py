"""MMA's subproblem, solved by its dual with one unknown per constraint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.design.mma.approximation import TINY, Approximation

STEPS = 100  # limit for unforeseen input; far more than ever needed
GROWTH = 10.0  # of a multiplier in one step, where the curvature does not limit it
EPSILON = np.finfo(np.float64).eps
FORCING = 0.1  # largest final residual over that of the starting multipliers
ROUNDING = 1e-13  # residual that rounding may leave: nothing smaller is requested
SHIFT = 1e-3  # of the Hessian, times the residual: it keeps the convergence superlinear
BLOCKS = 3  # exchanges of all wrong members in a row that may leave as many wrong


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
