"""Bounded, robust least squares, in which each group of values is weighted by its own spread."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from toros_fem.base.array_types import Floats, Ints
from toros_fem.products.options import LOSSES

# Values of a model and their derivatives, (n,) and (n, p), of parameters, (p,).
Model = Callable[[Floats], tuple[Floats, Floats]]

# Residual, in standard deviations, from which a robust loss grows linearly.
TUNING = 1.5
# Standard deviation of values of the size 1: at the start, and at least.
START, EXACT = 0.05, 1e-5
NORMAL_MAD = 1.4826
SPREAD_STEPS = 30


@dataclass(frozen=True, eq=False)
class Problem:
    """What is fitted to what.

    Attributes:
        measured: Measured values, each over the largest of its group, (n,).
        groups: Number of each value's group, (n,); a group has one standard deviation.
        bounds: Smallest and largest value of each parameter, (p,) each.
        loss: One of `LOSSES`.
        tolerance: Relative change of loss and parameters at which a minimum is found.
    """

    model: Model
    measured: Floats
    groups: Ints
    bounds: tuple[Floats, Floats]
    loss: str
    tolerance: float = 1e-10


@dataclass(frozen=True, eq=False)
class RobustFit:
    """Parameters at the minimum of the loss.

    Attributes:
        theta: Parameters, (p,).
        sigma: Standard deviation of each measured value, (n,).
        values, jac: Values of the model and their derivatives there, (n,) and (n, p).
    """

    theta: Floats
    sigma: Floats
    values: Floats
    jac: Floats


def remembered(model: Model) -> Model:
    """Return a model that computes no value twice: values and derivatives are asked for apart."""
    known = lru_cache(maxsize=8)(lambda theta: model(np.frombuffer(theta)))
    return lambda theta: known(theta.tobytes())


def robust_fit(problem: Problem, starts: Sequence[Floats], rounds: int = 4) -> RobustFit:
    """Return the fit of the smallest loss from several starts.

    Standard deviations follow from the residuals, and parameters from them, in turns: `rounds`.
    """
    sigma: Floats = np.full(len(problem.measured), START)
    tried = [minimise(problem, start, sigma) for start in starts]
    theta = min(tried, key=lambda found: found[1])[0]
    for _ in range(rounds):
        residuals = problem.measured - problem.model(theta)[0]
        kept = 1 - len(theta) / len(residuals)
        for group in np.unique(problem.groups):
            own = problem.groups == group
            sigma = np.where(own, _spread(residuals[own], kept, problem.loss), sigma)
        theta = minimise(problem, theta, sigma)[0]
    return RobustFit(theta, sigma, *problem.model(theta))


def minimise(problem: Problem, start: Floats, sigma: Floats) -> tuple[Floats, float]:
    """Return the parameters of the smallest loss from a start, and the loss.

    `sigma` has the standard deviations, (n,); an infinite one leaves a value out.
    """
    low, high = problem.bounds
    found = least_squares(
        lambda theta: (problem.model(theta)[0] - problem.measured) / sigma,
        np.clip(start, low + 1e-6 * (high - low), high - 1e-6 * (high - low)),
        lambda theta: problem.model(theta)[1] / sigma[:, None],
        problem.bounds,
        loss=LOSSES[problem.loss],
        f_scale=TUNING,
        max_nfev=300,
        **dict.fromkeys(("ftol", "xtol", "gtol"), problem.tolerance),
    )
    return np.asarray(found.x), float(found.cost)


def influence(residuals: Any, loss: str) -> Floats:
    """Return ψ, the derivative of a loss by residuals over their deviation."""
    if loss == "soft-l1":
        return np.asarray(residuals / np.sqrt(1 + (residuals / TUNING) ** 2))
    if loss == "huber":
        return np.clip(residuals, -TUNING, TUNING)
    return residuals


def _spread(residuals: Floats, kept: float, loss: str) -> float:
    """Return the standard deviation of residuals, robustly.

    It is Huber's second proposal (1964): the mean of ψ² is that of normal residuals. The median
    of their sizes starts it. `kept` is the part of the degrees of freedom that a fit leaves.
    """
    normal = np.linspace(-8, 8, 4001)
    density = np.exp(-(normal**2) / 2)
    expected = float(influence(normal, loss) ** 2 @ density / density.sum())
    spread = max(NORMAL_MAD * float(np.median(np.abs(residuals))), EXACT)
    for _ in range(SPREAD_STEPS):
        psi = influence(residuals / spread, loss)
        spread = max(spread * float(np.sqrt(np.mean(psi**2) / (kept * expected))), EXACT)
    return spread
