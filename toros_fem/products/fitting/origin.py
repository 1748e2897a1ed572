"""Where a tensile test begins and ends: at rest without force, and at its largest force.

A strip may hang slack before it pulls, fabric keeps a set after a cycle, a cell may be untared, a
strip preloaded, and the last points may lie behind the break. A wrong origin changes E h by several
times its own part of the largest strain, while R² stays good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from toros_fem.base.errors import FileError
from toros_fem.base.validation import Floats, Ints
from toros_fem.products.common.options import FitOptions
from toros_fem.products.fitting.samples import FEWEST, TensileTest, correlation
from toros_fem.products.fitting.uniaxial import (
    LARGEST_POISSON,
    NEAREST,
    SOFTEST,
    STEEPEST,
    Coefficients,
    lame,
    lateral_strain,
    pulling_stress,
    rubber_stress,
)

# The test ends at its largest force if the force falls by this part of it for good.
FALL = 0.2
# The beginning of a curve is where the force has risen by this part of its largest rise. It is
# looked at in this many points at most, and at least.
RISE, MOST, LEAST = 0.2, 150, 8
# Idle points at least, their slope over that where the force has risen at most, and what they must
# explain more than a curve without them, over the variance of the residuals.
IDLE, FLAT, CLEAR = 3, 0.2, 15.0
# A slope of the idle part below this one is none.
SHARP = 0.05
# The same where a curve of the model tells where they end.
FEWEST_IDLE = 2
# Relative spread of forces below which they count as exact.
EXACT = 1e-4
# Errors of the origin over the largest strain: from the first on the values are in doubt, from the
# second on the test is refused where preload and offset look alike. E h changes five times as much.
DOUBT, REFUSE = 5e-3, 0.02
# The first where the first points tell it.
SMALL = 2e-3
# Part of the strains whose curve tells a preload: beyond, it follows its bound.
NEAR = 0.6
# The beginning is a cubic polynomial within this part of its strains.
CUBIC = 5e-3
# A level that it tells is as good as this part of the largest stress.
EXACT_LEVEL = 4e-4
# An estimate differs from 0 if it is this many standard errors away.
SURE = 3.0
# A test is refused only if it is as many away.
CERTAIN = 5.0
# One that is so many away widens the intervals.
HIDDEN = 1.2
# A curve of the model misses the test if its residuals are this part of the largest stress.
MISSED = 0.05


Begun = tuple[TensileTest, float]
"""A test that begins at rest: the branch that is fitted, with what was taken in its remarks and
doubts, and the standard error of the strain at which it begins."""


@dataclass(frozen=True, eq=False)
class _Start:
    """The beginning of a curve as an idle level and a cubic polynomial after it.

    Attributes:
        at: Strain at which the force leaves its idle level.
        error: Standard error of `at`.
        level, level_error: Idle stress, or that at the strain 0 where there is no idle part.
        slope: Of the stress, after `at` or at the strain 0.
        idle: Number of idle points; 0 without an idle part.
        toe: Slope of the idle part over that after it, where noise does not explain it.
    """

    at: float
    error: float
    level: float
    level_error: float
    slope: float
    idle: int
    toe: float = 0.0


def from_rest(test: TensileTest, options: FitOptions) -> Begun:
    """Return the branch of a test that is fitted, from its rest to its largest force.

    Raises:
        FileError: It has no such branch, or it begins with a force that may be a preload or
            an offset, and `options.offset` does not tell which.
    """
    later = test.begins(options.branch) > 0
    branch, said = test.branch(options.branch), []
    if options.branch in ("first-loading", "last-loading"):
        branch, ended = _up_to_the_break(branch)
        said += [ended] if ended else []
    if options.branch == "all" or len(branch.stretch) < LEAST:
        return _with(branch, said, []), 0.0
    start = _start(branch)
    if start.idle:
        return _after_idle(branch, start, later, options, said)
    return _without_idle(branch, start, later, options, said)


def _with(test: TensileTest, said: list[str], doubts: list[str]) -> TensileTest:
    name = f"specimen {test.specimen!r}: "
    return replace(
        test,
        remarks=(*test.remarks, *[name + one for one in said]),
        doubts=(*test.doubts, *[name + one for one in doubts]),
    )


def _up_to_the_break(test: TensileTest) -> tuple[TensileTest, str]:
    """Return a loading up to its largest force, and words where it falls after that for good."""
    top = int(np.argmax(test.stress))
    after, largest = test.stress[top:], float(test.stress[top])
    rest = float(np.median(test.stress[: max(top, 1)].min(initial=largest)))
    low = after < largest - FALL * (largest - min(rest, 0.0))
    if top + 1 < FEWEST or not low[-1]:
        return test, ""
    words = (
        f"the force falls behind a stretch of {test.stretch[top]:.4g}, as at a break. The test "
        "ends there, at its largest force."
    )
    return test.taken(np.arange(top + 1)), words


def _after_idle(
    test: TensileTest, start: _Start, later: bool, options: FitOptions, said: list[str]
) -> Begun:
    """Return a test from where its force leaves the idle level."""
    at, level = start.at, start.level
    kind = options.start if options.start != "auto" else "set" if later else "slack"
    stress, doubts = test.stress, []
    top = float(np.abs(stress).max())
    if abs(level) > max(SURE * start.level_error, 1e-3 * top):
        said.append(
            f"the idle force, {level:.3g} N/m over the width, was taken off: the cell was not "
            "tared."
        )
        stress = stress - level
        if options.offset == "preload":
            doubts.append("--offset preload was not used: the force is idle before it rises.")
    moved = replace(test, stress=stress)
    if kind == "none":
        doubts.append(f"its force only rises from a strain of {100 * at:.3g} % on (--start none).")
        return _with(moved, said, doubts), 0.0
    how = "of a later cycle, so this is the set of the fabric, and the gauge length grows by it"
    if kind == "slack":
        how = "of a first loading, so this is slack, and the gauge length stays"
    if options.start != "auto":
        how = "which is " + how.split("this is ")[1]
    other = "set" if kind == "slack" else "slack"
    said.append(
        f"the force rises from a strain of {100 * at:.3g} % on, {how}; "
        f"--start {other} takes it for {other}."
    )
    moved = _moved(moved, at, kind == "set")
    spread = float(np.hypot(start.error, 2 * start.toe * at))
    if start.toe:
        doubts.append("its force rises by and by, a toe: the strain from which it does is vague.")
    rest = _fitted(moved.stretch - 1, moved.stress, options.kind)
    reach = float(moved.stretch.max() - 1)
    if rest.sure(HIDDEN) and not rest.missed:
        spread = float(np.hypot(spread, rest.strain))
        # Model and curve differ as much where the origin is right and the curve steep at first.
        least = DOUBT if rest.strain > 0 else 2 * DOUBT
        if rest.sure() and abs(rest.strain) > max(least * reach, 2 * start.error):
            doubts.append(_toe(rest))
    return _with(moved, said, doubts), spread


def _moved(test: TensileTest, at: float, longer: bool) -> TensileTest:
    """Return a test whose strains begin at `at`; the gauge length may be longer by it."""
    if not longer:
        return replace(test, stretch=np.maximum(test.stretch - at, 1e-3))
    lateral = test.lateral
    if lateral is not None:
        # What the strip had narrowed by at its new rest.
        x = test.stretch - 1
        near = np.argsort(np.abs(x - at), kind="stable")[: max(FEWEST, len(x) // 10)]
        line = np.polyfit(x[near], lateral[near], 1)
        lateral = np.asarray(lateral / float(np.polyval(line, max(at, float(x.min())))))
    return replace(test, stretch=np.asarray(test.stretch / (1 + at)), lateral=lateral)


def _without_idle(
    test: TensileTest, start: _Start, later: bool, options: FitOptions, said: list[str]
) -> Begun:
    """Return a test whose first points tell no idle level by themselves."""
    doubts: list[str] = []
    x, stress = test.stretch - 1, test.stress
    reach, top = float(x.max()), float(stress.max())
    if not (reach > 0 and top > 0):
        return _with(test, said, doubts), 0.0
    law = partial(_fitted, kind=options.kind)
    found, idle = law(x, stress), law(x, stress, level=True)
    flat = x < idle.strain
    # Idle points tell more than noise: without a level too, or by what they explain.
    likely = found.strain > 0 and found.sure(HIDDEN)
    likely |= idle.variance * (1 + CLEAR * idle.alike / len(x)) < found.variance
    if likely and idle.sure() and not idle.missed and flat.sum() >= FEWEST_IDLE:
        slope, error = _slope(x[flat], stress[flat]) if flat.sum() > 2 else (0.0, 0.0)
        after = float(stress[~flat].mean() - idle.level) / float(x[~flat].mean() - idle.strain)
        if abs(slope) < FLAT * after + 2 * error:
            spread = float(np.std(stress[flat])) / np.sqrt(flat.sum())
            error = float(np.hypot(idle.error, CUBIC * idle.strain))
            begun = _Start(idle.strain, error, idle.level, spread, start.slope, int(flat.sum()))
            return _after_idle(test, begun, later, options, said)
    slope = start.slope if start.slope > 0 else top / reach
    at_zero = start.level / slope  # as a strain
    sure = abs(start.level) > SURE * start.level_error
    # Noise may hide it at the beginning, and the whole curve tell it.
    hidden = found.sure() and start.level > start.level_error
    refused = at_zero > REFUSE * reach and start.level > CERTAIN * start.level_error
    refused |= hidden and min(at_zero, -found.strain) > 2 * REFUSE * reach
    if refused and options.offset == "ask":
        raise FileError(
            f"specimen {test.specimen!r}: at a strain of 0 the force is "
            f"{start.level:.3g} N/m over the width, {start.level / top:.2g} of the largest. Either "
            "the strip was preloaded when the strain was set to 0, or the cell was not tared. Tell "
            "which: --offset preload keeps the force and finds the length without it; --offset "
            "untared takes the force off."
        )
    negative = (
        -start.level > CERTAIN * start.level_error
        and at_zero < -REFUSE * reach
        and float(x.min()) < -0.5 * at_zero
    )
    if options.offset == "untared" or (negative and options.offset == "ask"):
        shift = law(x, stress, strain=False, level=True)
        # Where the model misses the first points, they tell it better.
        first = float(np.hypot(start.level_error, EXACT_LEVEL * top))
        better = first < abs(shift.level - start.level)
        level, error = (start.level, first) if better else (shift.level, shift.error)
        said.append(f"a force of {level:.3g} N/m over the width was taken off: an untared cell.")
        if options.offset == "ask":
            doubts.append("its force is negative at first, as of a cell that was not tared.")
        tared = replace(test, stress=np.asarray(stress - level))
        return _with(tared, said, doubts), error / slope
    if options.offset == "preload":
        near = x <= NEAR * reach
        close = law(x[near], stress[near])
        if close.strain < 0:
            percent = -100 * close.strain / (1 + close.strain)
            said.append(
                f"it was preloaded to a strain of {percent:.3g} %, as its curve tells, and the "
                "gauge length is shorter by it."
            )
            error = float(np.hypot(close.error, close.strain + at_zero))
            return _with(_moved(test, close.strain, longer=True), said, doubts), error
    late = found.sure(HIDDEN) and found.strain > 0 and not found.missed
    if sure and SMALL * reach < abs(at_zero) and not (late and at_zero < 0):
        doubts.append(
            f"its force at a strain of 0 is that of a strain of {100 * at_zero:.2g} %: a small "
            "preload or slack, or an untared cell. E h changes by more than that."
        )
        return _with(test, said, doubts), abs(at_zero)
    # A curve that is steeper at first than the model is no offset where its force begins at 0.
    if found.missed or (found.strain < 0 and found.sure()):
        return _with(test, said, doubts), 0.0
    if not found.sure() or abs(found.strain) < DOUBT * reach:
        wider = abs(found.strain) if found.sure(HIDDEN) and not found.missed else 0.0
        return _with(test, said, doubts), wider
    words = f"{100 * found.strain:.2g} %"
    if found.strain < float(x.min()) * 1.5 and options.start != "none":
        longer = options.start == "set" or (options.start == "auto" and later)
        said.append(f"it begins at a strain of {100 * x.min():.3g} %, and its force at {words}.")
        doubts.append(f"its rest was not recorded; its curve tells a strain of {words}.")
        return _with(_moved(test, found.strain, longer), said, doubts), found.error
    doubts.append(_toe(found))
    return _with(test, said, doubts), found.strain


def _toe(found: _Shift) -> str:
    return (
        f"it has a toe: the rest of its curve begins at a strain of {100 * found.strain:.2g} %, "
        "not at 0, which changes E h by more."
    )


def _means(values: Floats, parts: Sequence[Ints]) -> Floats:
    return np.array([values[part].mean() for part in parts], dtype=np.float64)


def _alike(residuals: Floats) -> float:
    """Return the variance of a mean of residuals over that of independent ones."""
    rho = correlation([residuals])
    return (1 + rho) / (1 - rho)


def _slope(x: Floats, y: Floats) -> tuple[float, float]:
    """Return the slope of a line, and its standard error."""
    own = x - x.mean()
    square = max(float(own @ own), 1e-300)
    slope = float(own @ y) / square
    rest = y - y.mean() - slope * own
    return slope, float(np.sqrt(rest @ rest / max(len(x) - 2, 1) / square))


def _start(test: TensileTest) -> _Start:
    """Return how a curve begins."""
    order = np.argsort(test.stretch, kind="stable")
    x, stress = test.stretch[order] - 1, test.stress[order]
    low = float(np.median(stress[:FEWEST]))
    high = np.flatnonzero(stress > low + RISE * (stress.max() - low))
    end = max(int(high[0]) if len(high) else len(x), min(LEAST, len(x)))
    parts = np.array_split(np.arange(end), min(end, MOST))
    x, stress = _means(x, parts), _means(stress, parts)
    unit, span = max(float(np.ptp(stress)), 1e-300), max(float(np.ptp(x)), 1e-300)
    y, n = np.asarray(stress / unit), len(x)

    def cubic(u: Floats, level: bool = True) -> Floats:
        ones = [np.ones_like(u)] if level else []
        return np.column_stack([*ones, u, u**2, u**3])

    def misfit(at: float) -> float:
        design = cubic(np.maximum(x - at, 0.0) / span)
        return float(np.sum((y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) ** 2))

    plain = cubic(np.asarray(x / span))
    found = np.linalg.lstsq(plain, y, rcond=None)[0]
    without = float(np.sum((y - plain @ found) ** 2))
    grid = np.linspace(x[0], x[0] + 0.9 * span, 90)
    values = [misfit(float(at)) for at in grid]
    k = int(np.argmin(values))
    bounds = (float(grid[max(k - 1, 0)]), float(grid[min(k + 1, len(grid) - 1)]))
    refined = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-7})
    at, least = (
        (float(refined.x), float(refined.fun))
        if refined.fun < values[k]
        else (float(grid[k]), values[k])
    )
    idle = int(np.sum(x < at))
    design = cubic(np.maximum(x - at, 0.0) / span)
    level, slope, *_ = bent = np.linalg.lstsq(design, y, rcond=None)[0]
    variance = (least / max(n - 5, 1) + EXACT**2) * _alike(y - design @ bent)
    if idle >= IDLE and (without - least) / variance > CLEAR and slope > 0 and at > 0:
        flat, own = x[:idle], y[:idle]
        steep = _slope(flat, own)[0]
        error = float(np.sqrt(variance) / max(np.std(flat) * np.sqrt(idle), 1e-300))
        mean = float((y[idle:] - own.mean()).sum() / max((x[idle:] - at).sum(), 1e-300))
        if abs(steep) < FLAT * mean + 2 * error:
            toe = max(abs(steep) - 2 * error, 0.0) / mean if steep > SHARP * mean else 0.0
            h = 0.02 * span
            bend = (misfit(at + h) + misfit(at - h) - 2 * least) / h**2
            spread = float(np.hypot(np.sqrt(2 * variance / bend) if bend > 0 else h, CUBIC * span))
            level_error = float(np.sqrt(variance / idle))
            return _Start(at, spread, float(level) * unit, level_error * unit,
                          float(slope) * unit / span, idle, toe)  # fmt: skip
    variance = (without / max(n - 4, 1) + EXACT**2) * _alike(y - plain @ found)
    spread = float(np.sqrt(variance * np.linalg.pinv(plain.T @ plain)[0, 0]))
    return _Start(0.0, 0.0, float(found[0]) * unit, spread * unit, float(found[1]) * unit / span, 0)


@dataclass(frozen=True)
class _Shift:
    """What a curve of the law tells of its own origin.

    Attributes:
        strain, level: At which it begins; 0 where it was not asked for.
        error: Standard error of the strain, or of the level where it alone was asked for.
        variance: Of the residuals, over the largest stress.
        alike: What correlation of neighbours makes of a variance of means, as of `_alike`.
    """

    strain: float
    level: float
    error: float
    variance: float
    alike: float

    @property
    def missed(self) -> bool:
        """Whether the curve misses the test."""
        return self.variance > MISSED**2

    def sure(self, times: float = SURE) -> bool:
        """Whether the strain differs from 0 by some standard errors."""
        return abs(self.strain) > times * self.error


def _fitted(
    x: Floats, stress: Floats, kind: str, *, strain: bool = True, level: bool = False
) -> _Shift:
    """Return the strain at which a curve of the law begins, the stress from which it does, or both.

    Of both the strain is positive, and the stress stays what it is up to there.
    """
    order = np.argsort(x, kind="stable")
    parts = np.array_split(order, min(len(order), MOST))
    x, stress = _means(x, parts), _means(stress, parts)
    reach, top = float(x.max()), float(np.abs(stress).max())
    rubber = kind == "rubber"
    asked = np.array([True] * 3 + [not rubber, strain, level])

    def model(some: Floats) -> Floats:
        theta = np.zeros(6)
        theta[asked] = some
        at = reach * theta[4]
        own = np.maximum(x - at, 0.0)
        if rubber:
            parts = rubber_stress(own, reach - at)
            shape = parts[0] + theta[1] * parts[1] + theta[2] * parts[2]
            return np.asarray(np.exp(theta[0]) * shape / top + theta[5])
        mu, lam = lame(np.exp(theta[0]), theta[1])
        c = Coefficients(mu, lam, *theta[2:4] / (reach - at) ** 2)
        return np.asarray(pulling_stress(own, lateral_strain(own, c), c) / top + theta[5])

    guess, least = np.log(top / reach), 0.0 if level else -0.5
    low = np.array([guess - 9, -1e-9, 1e-2, 1e-2, least - 1e-9, -0.5])[asked]
    high = np.array([guess + 9, LARGEST_POISSON, NEAREST**-2, NEAREST**-2, 0.5, 0.5])[asked]
    if rubber:
        low[1:3], high[1:3] = (-SOFTEST, -1e-9), STEEPEST
    tried = [
        least_squares(
            lambda theta: (model(theta) - stress / top) / 0.01,
            np.array([guess - fall, 0.3, bound, 0.2, at, 0.0])[asked],
            bounds=(low, high), loss="soft_l1", max_nfev=200,
            x_scale=np.array([1, 0.3, 0.3, 0.3, 0.1, 0.1])[asked],
        )
        for at in ((0.0, 0.12) if strain else (0.0,))
        for fall, bound in ((0.0, 0.2), (0.5, 0.8))
    ]  # fmt: skip
    found = min(tried, key=lambda one: float(one.cost))
    residuals, p = model(found.x) - stress / top, len(found.x)
    variance = float(np.mean(residuals**2)) * len(x) / max(len(x) - p, 1) + EXACT**2
    alike = _alike(residuals)
    precision = found.jac.T @ found.jac * 1e-4 / (variance * alike) + np.diag((high - low) ** -2.0)
    further = int(asked[:4].sum())
    error = float(np.sqrt(np.linalg.inv(precision)[further, further])) * (reach if strain else top)
    values = iter(found.x[further:])
    return _Shift(
        reach * float(next(values)) if strain else 0.0,
        top * float(next(values)) if level else 0.0,
        error,
        variance,
        alike,
    )
