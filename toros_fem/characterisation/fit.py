"""`fit_material`: material constants of eq. (1) from tensile tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem._validate import require_kind
from toros_fem.characterisation.fitting import (
    Estimator,
    Solution,
    samples_of,
    scales_of,
)
from toros_fem.characterisation.intervals import CONFIDENCE, bootstrap_draws, hessian_draws
from toros_fem.characterisation.options import FitOptions
from toros_fem.characterisation.result import (
    FitResult,
    estimates_of,
    r_squared,
    trusted_stretch,
)
from toros_fem.characterisation.tensile_test import TensileTest
from toros_fem.errors import ParameterError


def fit_material(tests: Sequence[TensileTest], options: FitOptions | None = None) -> FitResult:
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

    Returns:
        The constants with 95 % intervals.

    Raises:
        MeasurementError: There is no test, a test has too few points, thicknesses differ, or
            directions are not those of one fabric.
    """
    options, thickness = _checked(tests, options)
    samples = samples_of(tests, options)
    estimator = Estimator(samples, scales_of(samples), options.loss)
    solution = estimator.solve()
    return result_of(tests, options, thickness, estimator, solution)


def result_of(
    tests: Sequence[TensileTest],
    options: FitOptions,
    thickness: float,
    estimator: Estimator,
    solution: Solution,
    rounds: int = 0,
) -> FitResult:
    """Return the result of a fit, with its intervals.

    Args:
        tests: The tests.
        options: Options of the fit.
        thickness: In m.
        estimator, solution: The fit.
        rounds: Rounds of simulations of the clamped strip.
    """
    samples, scales = estimator.samples, estimator.scales
    drawn_by = bootstrap_draws if options.intervals == "bootstrap" else hessian_draws
    number = options.draws if options.intervals == "bootstrap" else max(options.draws, 4000)
    drawn = drawn_by(estimator, solution, number, options.seed)
    stress, lateral = estimator.curve(solution.theta)
    seen = samples.has_lateral
    return FitResult(
        estimates_of(
            scales.values(solution.theta, thickness),
            [scales.values(theta, thickness) for theta in drawn],
            scales.ranges(),
            CONFIDENCE,
        ),
        thickness,
        r_squared(samples.stress, stress),
        r_squared(samples.lateral[seen], lateral[seen]) if len(seen) else None,
        1 + float(samples.strain.max()),
        trusted_stretch(samples, stress),
        samples,
        stress,
        lateral,
        tuple(test.specimen for test in tests),
        options,
        scales.stiff,
        rounds,
    )


def _checked(
    tests: Sequence[TensileTest], options: FitOptions | None
) -> tuple[FitOptions, float]:
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


