"""Tensile tests as they are fitted: branches, points, robust least squares, and intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtri, stdtrit

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.validation import (
    Bools,
    Floats,
    Ints,
    checked_floats,
    require_choice,
    require_positive,
)
from toros_fem.products.common.options import BRANCHES, LOSSES, FitOptions

# A turn of the stretch smaller than this part of its range is noise.
TURN = 0.15
# Fewest points of a curve.
FEWEST = 5
# Values of a model and their derivatives, (n,) and (n, p), of parameters, (p,).
Model = Callable[[Floats], tuple[Floats, Floats]]
# Residual, in standard deviations, from which a robust loss grows linearly.
TUNING = 1.5
# Standard deviation of values of the size 1: at the start, and at least.
# Least deviation of widths over that of stresses, where stresses come first.
WIDTHS = 4.0
START, EXACT = 0.05, 1e-5
NORMAL_MAD = 1.4826
SPREAD_STEPS = 30
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


@dataclass(frozen=True, eq=False)
class TensileTest:
    """A strip pulled in one direction, free to narrow.

    Attributes:
        stretch: Stretch along the pull, (n,), in the order of the test.
        stress: Nominal stress per width in N/m, (n,): force over undeformed width.
        thickness: Thickness in m.
        lateral: Lateral stretch, (n,); None where it was not measured.
        specimen: Name of the specimen.
        direction: Direction of the pull: "course", "wale", or any other name.
        remarks, doubts: What was taken for granted of it, as sentences; doubts move the values.

    Raises:
        ParameterError: The arrays differ in length, are not finite, or have fewer than 5 points; a
            stretch is not positive, or always the same; the lateral stretch grows; all forces are
            0; or the thickness is not positive.
    """

    stretch: Floats
    stress: Floats
    thickness: float
    lateral: Floats | None = None
    specimen: str = "1"
    direction: str = ""
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_positive(thickness=self.thickness)
        stretch = checked_floats(
            "stretch", self.stretch, f"of shape (n,), n at least {FEWEST}",
            lambda shape: len(shape) == 1 and shape[0] >= FEWEST,
        )  # fmt: skip
        object.__setattr__(self, "stretch", stretch)
        object.__setattr__(self, "thickness", float(self.thickness))
        for name in ("stress",) if self.lateral is None else ("stress", "lateral"):
            what = f"of shape {stretch.shape}, as the stretch"
            values = checked_floats(name, getattr(self, name), what, stretch.shape)
            object.__setattr__(self, name, values)
        for fault in self._faults():
            raise ParameterError(fault)

    def _faults(self) -> Iterator[str]:
        """Yield what is wrong with the numbers, as sentences."""
        if not np.any(self.stress):
            yield f"all forces of specimen {self.specimen!r} are 0."
        for kind, one in (("stretch", self.stretch), ("lateral stretch", self.lateral)):
            what = f"the {kind} of specimen {self.specimen!r}"
            if one is not None and not (one.min() > 0 and np.ptp(one) > 0):
                yield (
                    f"{what} is {one.min():.6g} to {one.max():.6g}; it is positive, 1 at rest, and "
                    "not the same at all points."
                )
        if self.lateral is not None and np.cov(self.stretch, self.lateral)[0, 1] > 0:
            yield (
                f"the lateral stretch of specimen {self.specimen!r} grows with the stretch: is its "
                "sign right? A lateral strain is below 0 where the sheet gets narrower."
            )

    @property
    def curve(self) -> Floats:
        """Stretch, stress and lateral stretch, (3, n), which is NaN where it was not measured."""
        lateral = np.full(len(self.stretch), np.nan) if self.lateral is None else self.lateral
        return np.array([self.stretch, self.stress, lateral])

    def taken(self, rows: Ints) -> TensileTest:
        """Return the test with some of its points, by their numbers."""
        lateral = None if self.lateral is None else self.lateral[rows]
        return replace(self, stretch=self.stretch[rows], stress=self.stress[rows], lateral=lateral)

    def begins(self, which: str) -> int:
        """Return the number of branches before one of `BRANCHES`; 0 of all."""
        return 0 if which == "all" else self._ends(which)[2]

    def branch(self, which: str) -> TensileTest:
        """Return the points of one of `BRANCHES` of the load cycles; "all" takes every point.

        Raises:
            FileError: There is no such branch, or it has fewer than 5 points.
        """
        require_choice("branch", which, BRANCHES)
        if which == "all":
            return self
        begin, end, _ = self._ends(which)
        rows = np.arange(begin, end + 1)
        if len(rows) < FEWEST:
            kind = "unloading" if which == "last-unloading" else "loading"
            raise FileError(
                f"specimen {self.specimen!r}: the stretch has no branch of {kind}, or one of "
                f"{len(rows)} points; at least {FEWEST} are needed. Take another branch: "
                f"{', '.join(BRANCHES)}."
            )
        return self.taken(rows)

    def _ends(self, which: str) -> tuple[int, int, int]:
        """Return first and last point of a branch, and its number; no points if it is missing."""
        kind = "unloading" if which == "last-unloading" else "loading"
        found = [
            (begin, end, number)
            for number, (begin, end) in enumerate(_branches(self.stretch))
            if (self.stretch[end] > self.stretch[begin]) == (kind == "loading")
        ]
        return (found or [(0, -1, 0)])[0 if which == "first-loading" else -1]


def _branches(stretch: Floats) -> list[tuple[int, int]]:
    """Return first and last point of each branch, rising or falling.

    A branch ends where the stretch has turned by more than `TURN` of its range.
    """
    least = TURN * float(np.ptp(stretch))
    turns, sign, best = [0], 0.0, 0
    for k, value in enumerate(stretch):
        if sign == 0:
            if abs(value - stretch[0]) > least:
                sign = np.sign(value - stretch[0])
                turns, best = [int(np.argmin(sign * stretch[: k + 1]))], k
        elif sign * (value - stretch[best]) >= 0:
            best = k
        elif sign * (stretch[best] - value) > least:
            turns.append(best)
            sign, best = -sign, k
    return [(begin, end) for begin, end in pairwise([*turns, best]) if end > begin]


@dataclass(frozen=True, eq=False)
class Problem:
    """What is fitted to what.

    Attributes:
        measured: Measured values, each over the largest of its group, (n,).
        groups: Number of each value's group, (n,); a group has one standard deviation.
        bounds: Smallest and largest value of each parameter, (p,) each.
        loss: One of `LOSSES`.
        tolerance: Relative change of loss and parameters at which a minimum is found.
        stresses_first: Whether other values count less than stresses, the first group.
    """

    model: Model
    measured: Floats
    groups: Ints
    bounds: tuple[Floats, Floats]
    loss: str
    tolerance: float = 1e-10
    stresses_first: bool = False

    def with_stresses_first(self, sigma: Floats) -> Floats:
        """Return standard deviations, of which others are larger than those of stresses."""
        stresses = self.groups == 0
        if not (self.stresses_first and stresses.any()):
            return sigma
        return np.where(stresses, sigma, np.maximum(sigma, WIDTHS * sigma[stresses].max()))


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
    sigma = problem.with_stresses_first(np.full(len(problem.measured), START))
    tried = [minimise(problem, start, sigma) for start in starts]
    theta = min(tried, key=lambda found: found[1])[0]
    for _ in range(rounds):
        residuals = problem.measured - problem.model(theta)[0]
        kept = 1 - len(theta) / len(residuals)
        for group in np.unique(problem.groups):
            own = problem.groups == group
            sigma = np.where(own, _spread(residuals[own], kept, problem.loss), sigma)
        sigma = problem.with_stresses_first(sigma)
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


@dataclass(frozen=True, eq=False)
class Samples:
    """Curves of all tests as they are fitted.

    Attributes:
        strain: λ₁ − 1 of all points, (n,).
        stress: Per width in N/m, (n,).
        lateral: Lateral stretch, (n,), NaN where it was not measured.
        test: Number of the test of each point, (n,).
        direction, specimen: Direction and name of each test.
    """

    strain: Floats
    stress: Floats
    lateral: Floats
    test: Ints
    direction: tuple[str, ...]
    specimen: tuple[str, ...]

    @property
    def entries(self) -> Ints:
        """What was measured, of all stresses and then all lateral stretches, (2n,)."""
        return np.flatnonzero(np.isfinite(np.append(self.stress, self.lateral)))

    def along(self, direction: str | None) -> Bools:
        """Return whether each point is of a test along a direction, (n,)."""
        return np.array([one == direction for one in self.direction])[self.test]

    def curve_along(self, direction: str) -> Ints:
        """Return the points of the tests along a direction, by their stretch."""
        rows = np.flatnonzero(self.along(direction))
        return rows[np.argsort(self.strain[rows], kind="stable")]

    def problem(self, curve: Model, bounds: tuple[Floats, Floats], loss: str) -> Problem:
        """Return the fit of a curve: values of all points, (2, n), and derivatives, (2, n, p).

        Stresses count over the largest one of their direction.
        """
        count, entries = len(self.strain), self.entries
        largest = np.ones(count)
        for name in set(self.direction):
            own = self.along(name)
            largest[own] = np.abs(self.stress[own]).max()
        size = np.append(largest, np.ones(count))[entries]

        def model(theta: Floats) -> tuple[Floats, Floats]:
            values, slopes = curve(theta)
            stacked = slopes.reshape(2 * count, -1)[entries]
            return values.ravel()[entries] / size, stacked / size[:, None]

        measured = np.append(self.stress, self.lateral)[entries] / size
        # A law of two directions cannot always have both.
        both = len(set(self.direction)) > 1
        return Problem(model, measured, entries // count, bounds, loss, stresses_first=both)


def samples_of(
    tests: Sequence[TensileTest], options: FitOptions, *, whole: bool = False
) -> Samples:
    """Return the points that are fitted: one branch, thinned out evenly over the stretch.

    `whole` says that the tests are that branch already.

    Raises:
        FileError: A test has too few points above a stretch of 1.
    """
    curves = [
        _thinned(test, test if whole else test.branch(options.branch), options) for test in tests
    ]
    stretch, stress, lateral = np.hstack(curves)
    return Samples(
        stretch - 1,
        stress,
        lateral,
        np.repeat(np.arange(len(tests)), [curve.shape[1] for curve in curves]),
        tuple(test.direction for test in tests),
        tuple(test.specimen for test in tests),
    )


def _thinned(test: TensileTest, branch: TensileTest, options: FitOptions) -> Floats:
    """Return the curve of a branch of a test as it is fitted, (3, n)."""
    top = np.inf if options.up_to is None else options.up_to
    rows = np.flatnonzero((branch.stretch > 1) & (branch.stretch <= top))
    if len(rows) < FEWEST:
        raise FileError(
            f"specimen {test.specimen!r} has {len(rows)} points with a stretch above 1"
            + ("" if options.up_to is None else f" and up to {top:g}")
            + f" on the branch {options.branch!r}; at least {FEWEST} are needed."
        )
    curve = branch.taken(rows).curve
    if len(rows) <= options.points:
        return curve
    x = curve[0]
    bins = ((x - x.min()) / np.ptp(x) * options.points).astype(np.int64)
    _, bins = np.unique(np.minimum(bins, options.points - 1), return_inverse=True)
    sums = np.array([np.bincount(bins, weights=values) for values in curve])
    return np.asarray(sums / np.bincount(bins))


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
