"""Confidence intervals of a fit: by the curvature of the loss, or by drawing the tests again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter
from scipy.stats import norm
from scipy.stats import t as student

from toros_fem.base.array_types import Floats, Ints
from toros_fem.products.fitting.fitting import Estimator, Solution, influence

CONFIDENCE = 0.95
# From this number on whole tests are drawn, else residuals.
ENOUGH_TESTS = 3
# Points before a drawn curve begins, which forget its start.
WARM_UP = 100
LARGEST_CORRELATION = 0.95
# Parameters of a curve that lower the correlation of its residuals.
BIAS = 3.0


def hessian_draws(estimator: Estimator, solution: Solution, draws: int, seed: int) -> Floats:
    """Return parameters drawn from the normal distribution of an M-estimate, (draws, p).

    Its covariance is s² (JᵀJ)⁻¹ with s² = Σψ²/(n − p)/(mean ψ′)² (Huber 1981), ψ the derivative of
    the loss. Student's distribution takes the place of the normal one. What the data do not tell at
    all is spread over its bounds. Residuals are taken to be independent.
    """
    theta, sigma = solution.theta, solution.sigma
    values, slopes = estimator.model(theta)
    r = (estimator.samples.measured - values) / sigma
    J = slopes / sigma[:, None]
    psi, bend = influence(r, estimator.loss)
    degrees = max(len(r) - len(theta), 1)
    variance = float(psi @ psi) / degrees / max(float(bend.mean()), 0.1) ** 2
    low, high = estimator.scales.bounds()
    precision = J.T @ J / variance + np.diag((high - low) ** -2)
    root = np.linalg.cholesky(np.linalg.inv(precision))
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal((draws, len(theta)))
    chi = np.sqrt(rng.chisquare(degrees, (draws, 1)) / degrees)
    return np.asarray(np.clip(theta + (normal / chi) @ root.T, low, high))


def bootstrap_draws(estimator: Estimator, solution: Solution, draws: int, seed: int) -> Floats:
    """Return parameters fitted to data drawn again, (draws, p).

    Of three tests of each direction and more, whole tests are drawn: their differences are what
    is uncertain. Else residuals are drawn, with the correlation that neighbours have.
    """
    rng = np.random.default_rng(seed)
    samples, measured = estimator.samples, estimator.samples.measured
    rows = samples.rows_of_tests
    names = np.array(samples.direction)
    groups = [np.flatnonzero(names == name) for name in sorted(set(samples.direction))]
    whole = min(len(group) for group in groups) >= ENOUGH_TESTS
    values, slopes = estimator.model(solution.theta)
    n = len(measured)
    residuals = (measured - values) / _shrinkage(slopes / solution.sigma[:, None])
    found = np.empty((draws, len(solution.theta)))
    for k in range(draws):
        if whole:
            weight = np.zeros(n)
            for group in groups:
                for test in rng.choice(group, len(group)):
                    weight[rows[test]] += 1
            found[k] = estimator.minimise(solution.theta, solution.sigma, measured, weight)[0]
        else:
            drawn = values + _drawn(estimator, residuals, rng)
            found[k] = estimator.minimise(solution.theta, solution.sigma, drawn)[0]
    if whole:
        # Few tests drawn again vary too little: by (g − 1)/g, and their mean is Student's.
        least = min(len(group) for group in groups)
        ratio = student.ppf(0.5 + CONFIDENCE / 2, least - 1) / norm.ppf(0.5 + CONFIDENCE / 2)
        wider = np.sqrt(least / (least - 1)) * ratio
        low, high = estimator.scales.bounds()
        found = np.clip(solution.theta + wider * (found - solution.theta), low, high)
    return found


def _shrinkage(jacobian: Floats) -> Floats:
    """Return by which factor each residual is smaller than the error that it comes from, √(1 − h).

    h is the leverage of a point: its share in its own fitted value.
    """
    basis, size, _ = np.linalg.svd(jacobian, full_matrices=False)
    kept = basis[:, size > 1e-8 * size[0]]
    return np.asarray(np.sqrt(np.maximum(1 - np.sum(kept**2, axis=1), 0.1)))


def _drawn(estimator: Estimator, residuals: Floats, rng: np.random.Generator) -> Floats:
    """Return residuals drawn again along each curve, with the correlation of neighbours.

    Each is rₖ = ρ rₖ₋₁ + eₖ; the eₖ are drawn, of each test and kind of value apart.
    """
    out = np.empty_like(residuals)
    for curves in _curves(estimator):
        rho = correlation([residuals[rows] for rows in curves])
        for rows in curves:
            own = residuals[rows] - residuals[rows].mean()
            parts = np.append(np.sqrt(1 - rho**2) * own[0], own[1:] - rho * own[:-1])
            drawn = rng.choice(parts, WARM_UP + len(rows))
            out[rows] = lfilter([1.0], [1.0, -rho], drawn)[WARM_UP:]
    return out


def _curves(estimator: Estimator) -> list[list[Ints]]:
    """Return the rows of each curve, sorted by the stretch: those of stress, and the others."""
    samples = estimator.samples
    strain = np.concatenate([samples.strain, samples.strain[samples.has_lateral]])
    kinds = samples.is_stress, ~samples.is_stress
    sorted_rows = [rows[np.argsort(strain[rows], kind="stable")] for rows in samples.rows_of_tests]
    return [[rows[kind[rows]] for rows in sorted_rows if kind[rows].any()] for kind in kinds]


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
