"""Confidence intervals of a fit, by drawing the tests again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np
from scipy.special import ndtri, stdtrit

from toros_fem.base.array_types import Floats, Ints
from toros_fem.products.fitting.robust_fit import Problem, RobustFit, minimise
from toros_fem.products.fitting.samples import Samples

CONFIDENCE = 0.95
UPPER = 0.5 + CONFIDENCE / 2
# From this number on whole tests are drawn, else residuals.
ENOUGH_TESTS = 3
# Points before a drawn curve begins, which forget its start.
WARM_UP = 100
LARGEST_CORRELATION = 0.95
# Degrees of freedom of Student's distribution at least.
FEWEST_DEGREES = 2.0
# Parameters of a curve that lower the correlation of its residuals.
BIAS = 3.0


def drawn_again(
    problem: Problem, solution: RobustFit, samples: Samples, draws: int, seed: int
) -> Floats:
    """Return parameters fitted to data drawn again, (draws, p).

    Of three tests of each direction and more, whole tests are drawn: their differences are what
    is uncertain. Else residuals are drawn, with the correlation that neighbours have. Draws are
    spread as Student's distribution, of as many degrees as tests or independent points leave.
    """
    rng, theta, sigma = np.random.default_rng(seed), solution.theta, solution.sigma
    names = np.array(samples.direction)
    groups = [np.flatnonzero(names == name) for name in sorted(set(samples.direction))]
    least = min(len(group) for group in groups)
    if least < ENOUGH_TESTS:
        residuals = (problem.measured - solution.values) / _shrinkage(solution.jac / sigma[:, None])
        curves = [(c, correlation([residuals[rows] for rows in c])) for c in _curves(samples)]
        # Correlated points tell as much as so many independent ones.
        alone = [sum(map(len, c)) * (1 - rho) / (1 + rho) for c, rho in curves if c]
        left = [points - len(theta) for points in alone]
        wider = _student(min(left))
        data = (solution.values + _drawn(curves, residuals, rng) for _ in range(draws))
        again = (replace(problem, measured=measured) for measured in data)
        found = [minimise(one, theta, sigma)[0] for one in again]
        return np.asarray(np.clip(theta + wider * (np.array(found) - theta), *problem.bounds))
    test = samples.test[samples.entries % len(samples.strain)]
    found = []
    for _ in range(draws):
        drawn = np.concatenate([rng.choice(group, len(group)) for group in groups])
        times = np.bincount(drawn, minlength=len(names))[test]
        own = np.where(times > 0, sigma / np.sqrt(np.maximum(times, 1)), np.inf)
        found.append(minimise(problem, theta, own)[0])
    # Few tests drawn again vary too little: by (g − 1)/g, and their mean is Student's.
    wider = np.sqrt(least / (least - 1)) * _student(least - 1)
    return np.asarray(np.clip(theta + wider * (np.array(found) - theta), *problem.bounds))


def _student(degrees: float) -> float:
    """Return the ratio of Student's interval to the normal one."""
    return float(stdtrit(max(degrees, FEWEST_DEGREES), UPPER) / ndtri(UPPER))


def _shrinkage(jacobian: Floats) -> Floats:
    """Return each residual over the error that it comes from, √(1 − h), h a point's leverage."""
    basis, size, _ = np.linalg.svd(jacobian, full_matrices=False)
    kept = basis[:, size > 1e-8 * size[0]]
    return np.asarray(np.sqrt(np.maximum(1 - np.sum(kept**2, axis=1), 0.1)))


def _drawn(
    curves: Sequence[tuple[Sequence[Ints], float]], residuals: Floats, rng: np.random.Generator
) -> Floats:
    """Return residuals drawn again along each curve: rₖ = ρ rₖ₋₁ + eₖ, of which eₖ are drawn."""
    out = np.empty_like(residuals)
    for rows_of_tests, rho in curves:
        for rows in rows_of_tests:
            own = residuals[rows] - residuals[rows].mean()
            parts = np.append(np.sqrt(1 - rho**2) * own[0], own[1:] - rho * own[:-1])
            drawn = rng.choice(parts, WARM_UP + len(rows)).tolist()
            out[rows] = list(accumulate(drawn, lambda r, e, rho=rho: rho * r + e))[WARM_UP:]
    return out


def _curves(samples: Samples) -> list[list[Ints]]:
    """Return the entries of each curve, by its stretch: curves of stress, and lateral ones."""
    kind, point = np.divmod(samples.entries, len(samples.strain))
    order = np.argsort(samples.strain[point], kind="stable")
    curve = kind * len(samples.direction) + samples.test[point]
    return [
        [order[curve[order] == number] for number in np.unique(curve[kind == one])]
        for one in (0, 1)
    ]


def correlation(curves: Sequence[Floats]) -> float:
    """Return the correlation ρ of neighbouring residuals; 0 where it is within its own noise.

    What a fit takes out of residuals lowers it, by about 3 (1 + 2ρ)/n for each curve of n points
    and two of its constants (after Marriott & Pope 1954); this is put back.
    """
    own = [curve - curve.mean() for curve in curves]
    square = sum(float(one @ one) for one in own)
    number = sum(len(one) for one in own)
    if not own or square <= 0:
        return 0.0
    found = sum(float(one[1:] @ one[:-1]) for one in own) / square
    if found < 2 / np.sqrt(number):
        return 0.0
    n = number / len(own)
    return float(np.clip((found + BIAS / n) / (1 - 2 * BIAS / n), 0.0, LARGEST_CORRELATION))
