"""MMA's subproblem by its dual: as many unknowns as there are constraints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem._types import Floats
from toros_fem.mma.approximation import TINY, Approximation

STEPS = 100  # far more than ever seen: a bound on what unforeseen input can cost
GROWTH = 10.0  # of a multiplier in one step, where the curvature tells nothing about its size
EPSILON = np.finfo(np.float64).eps
FORCING = 0.1  # what is left of the starting multipliers' residual, at most
ROUNDING = 1e-13  # residual that rounding may leave: nothing smaller is requested
SHIFT = 1e-3  # of the Hessian, times the residual: it keeps the convergence superlinear


@dataclass(frozen=True)
class Price:
    """What violating each constraint by yᵢ costs: cᵢyᵢ + ½dᵢyᵢ².

    Attributes:
        linear, quadratic: cᵢ ≥ 0 and dᵢ > 0.
    """

    linear: Floats
    quadratic: Floats

    def violation(self, multipliers: Floats) -> Floats:
        """The yᵢ at which one more costs λᵢ."""
        return np.asarray(np.maximum(multipliers - self.linear, 0.0) / self.quadratic)


@dataclass(frozen=True)
class Solution:
    """Solution of a subproblem.

    Attributes:
        multipliers: λᵢ.
        residual: Of the optimality conditions, each constraint over what it can change by.
        evaluations: Passes over all variables.
    """

    multipliers: Floats
    residual: float
    evaluations: int


@dataclass(frozen=True)
class _Point:
    """The dual function at some multipliers: W, its slope, and its negative Hessian but for y's."""

    multipliers: Floats
    value: float
    magnitude: float
    slope: Floats
    hessian: Floats


def solve_subproblem(
    model: Approximation, values: Floats, price: Price, start: Floats | None, tolerance: float
) -> Solution:
    """Find the multipliers of the subproblem (Svanberg 2007, eqs. 3.1, 5.1; collective).

    min f̃₀(x) + Σᵢ cᵢyᵢ + ½dᵢyᵢ² subject to f̃ᵢ(x) − yᵢ ≤ 0, x in its box, y ≥ 0: the artificial
    variables y make it solvable whatever the constraints are. For given multipliers x and
    yᵢ = max(λᵢ − cᵢ, 0)/dᵢ have closed forms, and what is left is to maximise the concave dual W(λ)
    over λ ≥ 0. Its slope f̃(x(λ)) − y is continuous and piecewise smooth: Newton steps, each one
    the solution of a quadratic problem with the same bounds, and a line search converge from
    everywhere and fast (Pang & Qi, J. Optim. Theory Appl. 85, 1995). All decisions are made on
    reduced numbers, so the ranks agree.

    Args:
        model: The approximations.
        values: fᵢ(xᵏ).
        price: cᵢ and dᵢ.
        start: Multipliers to start from; None for a guess.
        tolerance: Residual to reach: maxᵢ |min(λᵢ/uᵢ, −∂W/∂λᵢ / sᵢ)| with sᵢ = |fᵢ| + Σⱼ|hᵢⱼ|,
            uᵢ the multiplier that would balance objective and constraint.
    """
    count = 1
    if len(values) == 0:
        return Solution(np.zeros(0), 0.0, 0)
    bend = model.size + model.curvature * model.total_weight
    unit = np.maximum(bend[0], TINY) / np.maximum(bend[1:], TINY)
    unit = np.clip(unit, TINY, np.where(price.linear > 0, price.linear, np.inf))
    size = np.abs(values) + model.size[1:]
    size[size == 0] = 1.0
    point = _evaluate(model, values, price, unit if start is None else start)
    residual = _residual(point, price, unit, size)
    # Near the outer solution the last multipliers pass as they are. Were they kept, the iterates
    # would drift off the constraints and stall there: the residual has to fall all the same.
    tolerance = max(min(tolerance, FORCING * residual), ROUNDING)
    for _ in range(STEPS):
        if residual <= tolerance:
            break
        ceiling = np.maximum(point.multipliers, unit)
        damping = SHIFT * min(1.0, residual)
        step = _newton(point, price, damping * (np.diag(point.hessian) + size / ceiling))
        share = 1 / max(1.0, float((step / (GROWTH * ceiling)).max()))
        before, shortest = float(point.slope @ step), 1e-10 * share
        while share > shortest and before > 0:
            trial = _evaluate(
                model, values, price, np.maximum(point.multipliers + share * step, 0.0)
            )
            count += 1
            after = float(trial.slope @ step)
            if _better(point, trial, share, before, after):
                break
            share *= min(max(before / (before - after), 0.1), 0.5)
        else:
            break  # rounding: no step makes it better any more
        point = trial
        residual = _residual(point, price, unit, size)
    return Solution(point.multipliers, residual, count)


def _evaluate(model: Approximation, values: Floats, price: Price, multipliers: Floats) -> _Point:
    response = model.respond(multipliers)
    y = price.violation(multipliers)
    there = values + response.change[1:]
    terms = np.concatenate(
        [response.change[:1], multipliers * there, -0.5 * price.quadratic * y * y]
    )
    return _Point(
        multipliers,
        float(terms.sum()),
        float(np.abs(terms).sum() + multipliers @ (np.abs(values) + model.size[1:])),
        there - y,
        response.hessian,
    )


def _residual(point: _Point, price: Price, unit: Floats, size: Floats) -> float:
    # y = (λ − c)/d is known to the rounding of λ only.
    rounding = 4 * EPSILON * point.multipliers / price.quadratic
    rounding = np.where(point.multipliers >= price.linear, rounding, 0.0)
    slope = point.slope - np.clip(point.slope, -rounding, rounding)
    return float(np.abs(np.minimum(point.multipliers / unit, -slope / size)).max())


def _newton(point: _Point, price: Price, shift: Floats) -> Floats:
    """Step to the maximum of W's model over λ ≥ 0: quadratic, and y(λ) as it is."""
    lam = point.multipliers
    excess = (lam - price.linear) / price.quadratic
    paid = excess > 0
    step: Floats = np.zeros(len(lam))
    for attempt in range(2 * len(lam) + 10):  # which yᵢ are above 0 settles in a few rounds
        # Where all variables sit at bounds, or constraints say the same, W's Hessian is singular.
        hessian = point.hessian + np.diag(shift + paid / price.quadratic)
        # The slope without y's part, as if yᵢ went on being (λᵢ − cᵢ)/dᵢ or 0.
        slope = point.slope + np.maximum(excess, 0.0) - np.where(paid, excess, 0.0)
        step = _above(hessian, slope, -lam)
        again = excess + step / price.quadratic > 0
        if np.array_equal(again, paid):
            break
        paid = again | paid if attempt > len(lam) else again  # no endless to and fro
    return step


def _above(hessian: Floats, slope: Floats, floor: Floats) -> Floats:
    """Maximum of slope·z − ½ z·H z over z ≥ floor ≤ 0."""
    scale = 1 / np.sqrt(np.diag(hessian))
    scaled = scale[:, None] * hessian * scale + 1e-12 * np.eye(len(slope))
    step = scale * np.linalg.solve(scaled, scale * slope)
    if np.all(step >= floor):
        return np.asarray(step)
    target = scale * slope - scaled @ (floor / scale)
    return np.asarray(scale * _nonnegative(scaled, target) + floor)


def _nonnegative(hessian: Floats, slope: Floats) -> Floats:
    """Maximum of slope·u − ½ u·H u over u ≥ 0, by Lawson and Hanson's active sets.

    scipy.optimize.nnls has this algorithm too, but stops at wrong sets in some versions.
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
            share = np.divide(u[out], gap, out=np.zeros(len(out)), where=gap > 0)
            u += share.min() * (trial - u)
            free[out[share <= share.min()]] = False
            u[~free] = 0.0
        if not free[new]:  # it came in by rounding
            break
    return u


def _better(old: _Point, new: _Point, share: float, before: float, after: float) -> bool:
    """Whether the step, along which W's slope went from `before` to `after`, is good enough."""
    if after >= 0:  # W is concave: it has risen all the way
        return True
    if share * max(before, -after) <= 1e-12 * (old.magnitude + new.magnitude):
        return -after <= 0.5 * before  # W itself is below rounding
    return new.value - old.value >= 1e-4 * share * before
