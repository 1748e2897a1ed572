"""Points of all tests as they are fitted: one branch each, even over the stretch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import MeasurementError
from toros_fem.products.fitting.robust_fit import Model, Problem
from toros_fem.products.fitting.tensile_test import FEWEST, TensileTest
from toros_fem.products.options import FitOptions


@dataclass(frozen=True, eq=False)
class Samples:
    """Curves of all tests as they are fitted.

    What is fitted are all stresses over the largest one, then the lateral stretches that were
    measured: entries of the stacked points, stress upon lateral stretch, (2n,).

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
        """Stacked points that are fitted."""
        return np.flatnonzero(np.isfinite(np.append(self.stress, self.lateral)))

    def along(self, direction: str | None) -> Bools:
        """Return whether each point is of a test along a direction, (n,)."""
        return np.array([one == direction for one in self.direction])[self.test]

    def problem(self, curve: Model, bounds: tuple[Floats, Floats], loss: str) -> Problem:
        """Return the fit of a model to the points.

        Args:
            curve: Stress and lateral stretch of all points, (2, n), and their derivatives by the
                parameters, (2, n, p).
            bounds: Smallest and largest value of each parameter.
            loss: Loss of the residuals.
        """
        count, entries = len(self.strain), self.entries
        size = np.repeat([float(np.abs(self.stress).max()), 1.0], count)[entries]

        def model(theta: Floats) -> tuple[Floats, Floats]:
            values, slopes = curve(theta)
            stacked = slopes.reshape(2 * count, -1)[entries]
            return values.ravel()[entries] / size, stacked / size[:, None]

        measured = np.append(self.stress, self.lateral)[entries] / size
        return Problem(model, measured, entries // count, bounds, loss)


def samples_of(tests: Sequence[TensileTest], options: FitOptions) -> Samples:
    """Return the points that are fitted: one branch, thinned out evenly over the stretch.

    Raises:
        MeasurementError: A test has too few points above a stretch of 1.
    """
    parts = [_thinned(test.branch(options.branch), options) for test in tests]
    lateral = [np.nan * one.stretch if one.lateral is None else one.lateral for one in parts]
    return Samples(
        np.concatenate([part.stretch for part in parts]) - 1,
        np.concatenate([part.stress for part in parts]),
        np.concatenate(lateral),
        np.repeat(np.arange(len(parts)), [len(part.stretch) for part in parts]),
        tuple(part.direction for part in parts),
        tuple(part.specimen for part in parts),
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
    bins = ((x - x.min()) / np.ptp(x) * options.points).astype(np.int64)
    _, bins = np.unique(np.minimum(bins, options.points - 1), return_inverse=True)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(bins, weights=values) / np.bincount(bins))

    across = None if kept.lateral is None else mean(kept.lateral)
    return replace(kept, stretch=mean(x), stress=mean(kept.stress), lateral=across)
