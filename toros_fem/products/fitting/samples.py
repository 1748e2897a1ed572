"""Points of all tests as they are fitted: one branch each, even over the stretch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import FileError
from toros_fem.products.fitting.robust_fit import Model, Problem
from toros_fem.products.fitting.tensile_test import FEWEST, TensileTest
from toros_fem.products.options import FitOptions


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

        Stresses count over the largest one.
        """
        count, entries = len(self.strain), self.entries
        size = np.repeat([float(np.abs(self.stress).max()), 1.0], count)[entries]

        def model(theta: Floats) -> tuple[Floats, Floats]:
            values, slopes = curve(theta)
            stacked = slopes.reshape(2 * count, -1)[entries]
            return values.ravel()[entries] / size, stacked / size[:, None]

        measured = np.append(self.stress, self.lateral)[entries] / size
        return Problem(model, measured, entries // count, bounds, loss)


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
