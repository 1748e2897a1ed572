"""Confidence intervals of a fit: by the curvature of the loss, or by drawing the tests again."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from toros_fem._types import Floats
from toros_fem.characterisation.fitting import Estimator, Solution, influence

CONFIDENCE = 0.95
# From this number on whole tests are drawn, else blocks of residuals.
ENOUGH_TESTS = 3


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
    is uncertain. Else residuals are drawn in blocks, along the stretch, since neighbours are alike.
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
            drawn = values + _blocks(estimator, residuals, rng)
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


def _blocks(estimator: Estimator, residuals: Floats, rng: np.random.Generator) -> Floats:
    """Return residuals drawn in blocks of neighbours, within each test and kind of value."""
    out = np.empty_like(residuals)
    is_stress = estimator.samples.is_stress
    for rows in estimator.samples.rows_of_tests:
        for own in (rows[is_stress[rows]], rows[~is_stress[rows]]):
            if not len(own):
                continue
            size = block_length(residuals[own])
            starts = rng.integers(0, len(own), -(-len(own) // size))
            order = (starts[:, None] + np.arange(size)).ravel()[: len(own)] % len(own)
            out[own] = (residuals[own] - residuals[own].mean())[order]
    return out


def block_length(residuals: Floats) -> int:
    """Return a length of blocks for residuals: as far as neighbours are correlated.

    It is the first lag at which the autocorrelation is within its own noise, 2/√n.
    """
    n = len(residuals)
    r = residuals - residuals.mean()
    variance = float(r @ r)
    if variance == 0:
        return 1
    for lag in range(1, max(n // 4, 1)):
        if float(r[lag:] @ r[:-lag]) / variance < 2 / np.sqrt(n):
            return lag
    return max(n // 4, 1)
