"""Fit of eq. (1) to tensile tests: bounded, robust least squares, weighted by the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from scipy.optimize import least_squares

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import MeasurementError
from toros_fem.base.keys import In, Number, OneOf, Stretch, Table, key
from toros_fem.products.fitting.parameters import Scales
from toros_fem.products.fitting.tensile_test import BRANCHES, FEWEST, TensileTest
from toros_fem.products.fitting.uniaxial import tension

# Residual, in standard deviations, from which a robust loss grows linearly.
TUNING = 1.5
# Standard deviations are at least this part of the largest stress, and this lateral stretch.
EXACT = 1e-5
# Rounds of fit and weights.
ROUNDS = 4
NORMAL_MAD = 1.4826
SPREAD_STEPS = 30
# Names of perpendicular directions; a knit is fitted to both.
PAIRS = (("course", "wale"), ("x", "y"), ("along", "across"), ("warp", "weft"))
LOSS = {"soft-l1": "soft_l1", "huber": "huber", "squares": "linear"}
LOSSES = ("soft-l1", "huber", "squares")
INTERVALS = ("bootstrap", "hessian")


@dataclass(frozen=True)
class FitOptions(Table):
    """How a material is fitted to tensile tests."""

    branch: Annotated[str, OneOf(BRANCHES)] = key(
        "last-loading", "branch of the load cycles that is fitted"
    )
    up_to: Stretch | None = key(None, "largest stretch that is fitted; none takes all")
    loss: Annotated[str, OneOf(LOSSES)] = key(
        "soft-l1", "loss of the residuals; the first two bound what an outlier counts"
    )
    intervals: Annotated[str, OneOf(INTERVALS)] = key(
        "bootstrap", "source of the 95 % intervals: tests drawn again, or the curvature of the loss"
    )
    draws: Annotated[int, In(at_least=40, at_most=100000)] = key(400, "draws of the bootstrap")
    seed: Number = key(0, "seed of the bootstrap")
    points: Annotated[int, In(at_least=10, at_most=10000)] = key(
        60, "points that each curve is averaged to, even over the stretch"
    )


@dataclass(frozen=True, eq=False)
class Samples:
    """Curves of all tests as they are fitted.

    Attributes:
        strain: λ₁ − 1 of all points, (n,).
        stress: Per width in N/m, (n,).
        lateral: Lateral stretch, (n,), NaN where it was not measured.
        test: Number of the test of each point, (n,).
        direction: Direction of each test.
        stress_factor: Factor on the stress of a free strip, (n,), that of its clamps.
        lateral_shift: What clamps add to the lateral stretch, (n,).
    """

    strain: Floats
    stress: Floats
    lateral: Floats
    test: Ints
    direction: tuple[str, ...]
    stress_factor: Floats
    lateral_shift: Floats

    @property
    def measured(self) -> Floats:
        """Stresses, then the lateral stretches that were measured."""
        return np.concatenate([self.stress, self.lateral[self.has_lateral]])

    @property
    def has_lateral(self) -> Ints:
        """Numbers of the points with a lateral stretch."""
        return np.flatnonzero(np.isfinite(self.lateral))

    @property
    def is_stress(self) -> Bools:
        """Whether each entry of `measured` is a stress."""
        return np.arange(len(self.stress) + len(self.has_lateral)) < len(self.stress)

    @property
    def rows_of_tests(self) -> list[Ints]:
        """Entries of `measured` of each test."""
        test = np.concatenate([self.test, self.test[self.has_lateral]])
        return [np.flatnonzero(test == k) for k in range(len(self.direction))]


def samples_of(tests: Sequence[TensileTest], options: FitOptions) -> Samples:
    """Return the points that are fitted: one branch, thinned out evenly over the stretch.

    Raises:
        MeasurementError: A test has too few points above a stretch of 1.
    """
    parts = [_thinned(test.branch(options.branch), options) for test in tests]
    sizes = [len(part.stretch) for part in parts]
    lateral = [
        np.full(n, np.nan) if part.lateral is None else part.lateral
        for part, n in zip(parts, sizes, strict=True)
    ]
    count = sum(sizes)
    return Samples(
        np.concatenate([part.stretch for part in parts]) - 1,
        np.concatenate([part.stress for part in parts]),
        np.concatenate(lateral),
        np.repeat(np.arange(len(parts)), sizes),
        tuple(part.direction for part in parts),
        np.ones(count),
        np.zeros(count),
    )


def _thinned(test: TensileTest, options: FitOptions) -> TensileTest:
    top = np.inf if options.up_to is None else options.up_to
    rows = np.flatnonzero((test.stretch > 1) & (test.stretch <= top))
    if len(rows) < FEWEST:
        raise MeasurementError(
            f"specimen {test.specimen!r} has {len(rows)} points with a stretch above 1"
            + ("" if options.up_to is None else f" and up to {top:g}")
            + f" on the branch {options.branch!r}; at least {FEWEST} are needed."
        )
    kept = test.taken(rows)
    if len(rows) <= options.points:
        return kept
    x = kept.stretch
    bins = np.minimum(
        ((x - x.min()) / np.ptp(x) * options.points).astype(np.int64), options.points - 1
    )
    count = np.bincount(bins, minlength=options.points)
    filled = count > 0

    def mean(values: Floats) -> Floats:
        sums = np.bincount(bins, weights=values, minlength=options.points)
        return np.asarray(sums[filled] / count[filled])

    across = None if kept.lateral is None else mean(kept.lateral)
    return replace(kept, stretch=mean(x), stress=mean(kept.stress), lateral=across)


def scales_of(samples: Samples) -> Scales:
    """Return the scales of the fit's parameters, and which of two directions is the stiffer.

    Raises:
        MeasurementError: The directions are not those of one fabric, or no stress is tension.
    """
    found = sorted(set(samples.direction))
    if len(found) > 1 and not any(set(found) == set(pair) for pair in PAIRS):
        pairs = "; ".join(" and ".join(pair) for pair in PAIRS)
        raise MeasurementError(
            f"the tests have the directions {', '.join(map(repr, found))}. Two are fitted together "
            f"if they are perpendicular, named {pairs}. Name them so, or fit one by --direction."
        )
    names = np.array(samples.direction)[samples.test]
    x, total = samples.strain, samples.strain + samples.lateral - 1
    largest = float(x.max())
    sums = total[samples.has_lateral]
    common = min(float(x[names == name].max()) for name in found)
    secants = {}
    for name in found:
        rows = (names == name) & (x <= common)
        secants[name] = float(x[rows] @ samples.stress[rows]) / float(x[rows] @ x[rows])
    if not min(secants.values()) > 0:
        raise MeasurementError(
            "the stresses fall with the stretch: is the sign of the force that of tension?"
        )
    return Scales(
        largest,
        max(float(sums.max()), 0.05 * largest) if len(sums) else None,
        min(secants.values()),
        max(found, key=lambda name: secants[name]) if len(found) > 1 else None,
    )


@dataclass(frozen=True, eq=False)
class Solution:
    """Parameters at the minimum of the loss.

    Attributes:
        theta: Parameters, (p,).
        sigma: Standard deviation of each entry of `Samples.measured`.
        cost: Loss.
    """

    theta: Floats
    sigma: Floats
    cost: float


class Estimator:
    """The fit of samples: model, residuals and their derivatives.

    Args:
        samples: The points.
        scales: Scales of the parameters.
        loss: One of `LOSSES`.
    """

    def __init__(self, samples: Samples, scales: Scales, loss: str) -> None:
        self.samples, self.scales, self.loss = samples, scales, LOSS[loss]
        names = np.array(samples.direction)[samples.test]
        self._groups = [
            (name, np.flatnonzero(names == name)) for name in dict.fromkeys(samples.direction)
        ]
        self._row = np.full(len(samples.strain), -1)
        self._row[samples.has_lateral] = len(samples.strain) + np.arange(len(samples.has_lateral))
        self._count = len(samples.strain) + len(samples.has_lateral)

    def model(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the model's values of `Samples.measured`, and their derivatives, (n, p)."""
        samples = self.samples
        values, slopes = np.empty(self._count), np.empty((self._count, len(theta)))
        for direction, points in self._groups:
            curve = tension(samples.strain[points], self.scales.coefficients(theta, direction))
            chain = self.scales.chain(theta, direction)
            factor = samples.stress_factor[points]
            values[points] = factor * curve.stress
            slopes[points] = factor[:, None] * (curve.stress_by @ chain)
            own = samples.lateral_shift[points] + curve.lateral
            seen = self._row[points] >= 0
            rows = self._row[points][seen]
            values[rows] = own[seen]
            slopes[rows] = curve.lateral_by[seen] @ chain
        return values, slopes

    def curve(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the model's stress and lateral stretch at all points, (n,) each."""
        samples = self.samples
        stress, lateral = np.empty(len(samples.strain)), np.empty(len(samples.strain))
        for direction, points in self._groups:
            found = tension(samples.strain[points], self.scales.coefficients(theta, direction))
            stress[points] = samples.stress_factor[points] * found.stress
            lateral[points] = samples.lateral_shift[points] + found.lateral
        return stress, lateral

    def minimise(
        self, start: Floats, sigma: Floats, measured: Floats, weight: Floats | None = None
    ) -> tuple[Floats, float]:
        """Return the parameters of the smallest loss from a start, and the loss.

        Args:
            start: Parameters.
            sigma: Standard deviation of each measured value.
            measured: Measured values.
            weight: How often each value counts; None for once.
        """
        low, high = self.scales.bounds()
        root = np.ones_like(sigma) if weight is None else np.sqrt(weight)
        used = np.flatnonzero(root > 0)

        def residuals(theta: Floats) -> Floats:
            return np.asarray((root * (self.model(theta)[0] - measured) / sigma)[used])

        def jacobian(theta: Floats) -> Floats:
            return np.asarray(((root / sigma)[:, None] * self.model(theta)[1])[used])

        inner = np.clip(start, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        found = least_squares(
            residuals, inner, jacobian, (low, high), x_scale=1.0, loss=self.loss,
            f_scale=TUNING, ftol=1e-10, xtol=1e-10, gtol=1e-10, max_nfev=300,
        )  # fmt: skip
        return np.asarray(found.x), float(found.cost)

    def solve(self, starts: Sequence[Floats] | None = None) -> Solution:
        """Return the fit: residuals and weights in turns, from several starts."""
        samples, measured = self.samples, self.samples.measured
        is_stress = samples.is_stress
        sigma = np.where(is_stress, 0.05 * float(np.abs(samples.stress).max()), 0.05)
        tried = [self.minimise(start, sigma, measured) for start in starts or self.scales.starts()]
        theta, cost = min(tried, key=lambda found: found[1])
        for _ in range(ROUNDS):
            sigma = self._spread(measured - self.model(theta)[0], len(theta))
            theta, cost = self.minimise(theta, sigma, measured)
        return Solution(theta, sigma, cost)

    def _spread(self, residuals: Floats, parameters: int) -> Floats:
        """Return the standard deviation of stresses and of lateral stretches, robustly.

        It is Huber's second proposal (1964): the mean of ψ² is that of normal residuals. The median
        of their sizes starts it.
        """
        samples = self.samples
        top = float(np.abs(samples.stress).max())
        sigma = np.empty(len(residuals))
        kept = 1 - parameters / len(residuals)
        normal = np.linspace(-8, 8, 4001)
        density = np.exp(-(normal**2) / 2)
        expected = float(influence(normal, self.loss)[0] ** 2 @ density / density.sum())
        for own, least in ((samples.is_stress, EXACT * top), (~samples.is_stress, EXACT)):
            if own.any():
                spread = max(NORMAL_MAD * float(np.median(np.abs(residuals[own]))), least)
                for _ in range(SPREAD_STEPS):
                    psi = influence(residuals[own] / spread, self.loss)[0]
                    spread *= np.sqrt(float(np.mean(psi**2)) / (kept * expected))
                    spread = max(spread, least)
                sigma[own] = spread
        return sigma


def influence(residuals: Any, loss: str) -> tuple[Floats, Floats]:
    """Return ψ and ψ′, the first two derivatives of a loss by residuals over their deviation."""
    z = (residuals / TUNING) ** 2
    if loss == "soft_l1":
        return residuals / np.sqrt(1 + z), (1 + z) ** -1.5
    if loss == "huber":
        return np.clip(residuals, -TUNING, TUNING), (z < 1).astype(np.float64)
    return residuals, np.ones_like(residuals)
