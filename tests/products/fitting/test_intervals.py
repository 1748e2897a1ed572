"""Correlation of neighbouring residuals, and what it does to intervals."""

import numpy as np
import pytest
from helpers.tensile_tests import synthetic
from scipy.signal import lfilter

from toros_fem import fit_material
from toros_fem.products.fitting.intervals import correlation
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.options import FitOptions


def curve(rng: np.random.Generator, rho: float, points: int) -> np.ndarray:
    return np.asarray(lfilter([1.0], [1.0, -rho], rng.standard_normal(points + 100))[100:])


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_correlation_is_found(rho: float) -> None:
    curves = [curve(np.random.default_rng(seed), rho, 400) for seed in range(5)]
    assert correlation(curves) == pytest.approx(rho, abs=0.06)


def test_noise_without_correlation() -> None:
    """Of white noise the correlation is 0 but in one case of forty."""
    found = [correlation([curve(np.random.default_rng(k), 0.0, 60)]) for k in range(40)]
    assert sum(one > 0 for one in found) <= 3
    assert correlation([np.zeros(10)]) == 0.0
    assert correlation([]) == 0.0


def test_correlated_noise_widens_intervals() -> None:
    """The same spread of residuals tells less where neighbours are alike."""
    white, rng = synthetic(7, points=60), np.random.default_rng(8)
    exact = synthetic(points=60)
    scale = 0.02 * exact.stress.max()
    noise = curve(rng, 0.8, 60) * 0.6
    across = exact.lateral + 0.01 * 0.6 * curve(rng, 0.8, 60)
    alike = TensileTest(exact.stretch, exact.stress + scale * noise, exact.thickness, across)
    options = FitOptions(draws=60)
    first, second = (fit_material([test], options).estimates["young"] for test in (white, alike))
    assert second.high - second.low > 1.5 * (first.high - first.low)
