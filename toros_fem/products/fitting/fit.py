"""`fit_material`: material constants of eq. (1) from tensile tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import MeasurementError, ParameterError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import require_kind
from toros_fem.materials.sheet import Material
from toros_fem.products.fitting.fitting import (
    Estimator,
    FitOptions,
    Samples,
    Solution,
    samples_of,
    scales_of,
)
from toros_fem.products.fitting.intervals import CONFIDENCE, bootstrap_draws, hessian_draws
from toros_fem.products.fitting.parameters import Scales
from toros_fem.products.fitting.result import FitResult, estimates_of
from toros_fem.products.fitting.strip import ClampedStrip
from toros_fem.products.fitting.tensile_test import TensileTest

# Rounds of fit and simulation of a clamped strip, and the change of its stress at which they end.
MOST_ROUNDS, SAME = 8, 1e-3


def fit_material(
    tests: Sequence[TensileTest],
    options: FitOptions | None = None,
    strip: ClampedStrip | None = None,
) -> FitResult:
    """Fit μ, λ, c₁ and c₂ of eq. (1) to tensile tests.

    The strip narrows freely: at each stretch the lateral one is solved for exactly. Residuals of
    stress and lateral stretch are weighted by their own spread. c₁ lies beyond the largest
    measured stretch, c₂ beyond the largest measured sum. Tests in two perpendicular directions
    ("course" and "wale", "x" and "y", "along" and "across", "warp" and "weft") are fitted together,
    with the ratio of a `Knit` whose courses run along the stiffer one; tests in one direction as
    an isotropic sheet.

    Args:
        tests: Tests of one material.
        options: Branch, loss and intervals.
        strip: The strip between its clamps, whose distance the stretch is that of: the fit and
            simulations of the strip take turns until the model curve is the simulated one
            (collective). None takes strips that narrow freely.

    Returns:
        The constants with 95 % intervals.

    Raises:
        NoEquilibriumError: The simulated strip has no equilibrium.
        MeasurementError: There is no test, a test has too few points, thicknesses differ, or
            directions are not those of one fabric.
    """
    options, thickness = _checked(tests, options)
    samples = samples_of(tests, options)
    if strip is None:
        estimator = Estimator(samples, scales_of(samples), options.loss)
        return _result(tests, options, thickness, estimator, estimator.solve(), 0)
    require_kind("strip", strip, ClampedStrip, "a ClampedStrip, or None")
    return _fit_clamped(tests, options, thickness, samples, strip)


def _fit_clamped(
    tests: Sequence[TensileTest],
    options: FitOptions,
    thickness: float,
    samples: Samples,
    strip: ClampedStrip,
) -> FitResult:
    """Fit and simulate in turns (collective)."""
    comm, scales = strip.comm, scales_of(samples)
    solution: Solution | None = None
    top = float(np.abs(samples.stress).max())
    rounds = 0
    while True:
        rounds += 1
        estimator = Estimator(samples, scales, options.loss)
        starts = None if solution is None else [solution.theta]
        solution = on_first_rank(comm, partial(estimator.solve, starts))
        before = estimator.curve(solution.theta)[0]
        samples = _clamped(samples, strip, scales, solution.theta, thickness)
        estimator = Estimator(samples, scales, options.loss)
        change = float(np.abs(estimator.curve(solution.theta)[0] - before).max())
        if change <= SAME * top:
            break
        if rounds == MOST_ROUNDS:
            raise MeasurementError(
                f"after {MOST_ROUNDS} rounds fit and simulated strip still differ by "
                f"{change / top:.1%} of the largest stress. Fit fewer data by up_to."
            )
    found = solution
    return on_first_rank(comm, lambda: _result(tests, options, thickness, estimator, found, rounds))


def _clamped(
    samples: Samples, strip: ClampedStrip, scales: Scales, theta: Floats, thickness: float
) -> Samples:
    """Return samples with what clamps change at these parameters (collective)."""
    values = scales.values(theta, thickness)
    sheet = Material(values["young"], values["poisson"], thickness)
    names = np.array(samples.direction)[samples.test]
    factor, shift = samples.stress_factor.copy(), samples.lateral_shift.copy()
    for name in dict.fromkeys(samples.direction):
        rows = names == name
        factor[rows], shift[rows] = strip.correction(
            sheet,
            values["c1"],
            values["c2"],
            samples.strain[rows],
            knit_ratio=max(values.get("knit_ratio", 1.0), 1.0),
            direction="course" if name == scales.stiff else "wale",
        )
    return replace(samples, stress_factor=factor, lateral_shift=shift)


def _result(
    tests: Sequence[TensileTest],
    options: FitOptions,
    thickness: float,
    estimator: Estimator,
    solution: Solution,
    rounds: int,
) -> FitResult:
    """Return the result of a fit, with its intervals."""
    samples, scales = estimator.samples, estimator.scales
    drawn_by = bootstrap_draws if options.intervals == "bootstrap" else hessian_draws
    number = options.draws if options.intervals == "bootstrap" else max(options.draws, 4000)
    drawn = drawn_by(estimator, solution, number, options.seed)
    stress, lateral = estimator.curve(solution.theta)
    return FitResult(
        estimates=estimates_of(
            scales.values(solution.theta, thickness),
            [scales.values(theta, thickness) for theta in drawn],
            scales.ranges(),
            CONFIDENCE,
        ),
        samples=samples,
        stress=stress,
        lateral=lateral,
        specimens=tuple(test.specimen for test in tests),
        options=options,
        thickness=thickness,
        stiff=scales.stiff,
        rounds=rounds,
    )


def _checked(tests: Sequence[TensileTest], options: FitOptions | None) -> tuple[FitOptions, float]:
    options = FitOptions() if options is None else options
    require_kind("options", options, FitOptions, "FitOptions, or None")
    if not isinstance(tests, list | tuple) or not tests:
        raise ParameterError("tests must be a list of at least one TensileTest.")
    for test in tests:
        require_kind("tests", test, TensileTest, "a list of TensileTest")
    heights = [test.thickness for test in tests]
    thickness = float(np.mean(heights))
    if np.ptp(heights) > 0.5 * thickness:
        raise ParameterError(
            f"the thicknesses {min(heights):.4g} to {max(heights):.4g} m are not those of one "
            "material: fit them apart."
        )
    return options, thickness
