"""`fit_material`: material constants of eq. (1) from tensile tests."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_list, require_kind
from toros_fem.products.fitting.intervals import drawn_again
from toros_fem.products.fitting.origin import from_rest
from toros_fem.products.fitting.parameters import scales_of
from toros_fem.products.fitting.result import FitResult, estimates_of
from toros_fem.products.fitting.robust_fit import (
    Model,
    Problem,
    RobustFit,
    minimise,
    remembered,
    robust_fit,
)
from toros_fem.products.fitting.samples import samples_of
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.fitting.uniaxial import tension
from toros_fem.products.options import FitOptions


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
        FileError: There is no test, a test has too few points, thicknesses differ, or
            directions are not those of one fabric.
    """
    options = FitOptions() if options is None else options
    require_kind("options", options, FitOptions, "FitOptions, or None")
    return _Fit(tests, options).result()


def _thickness(tests: Sequence[TensileTest]) -> float:
    heights = [test.thickness for test in tests]
    thickness = float(np.mean(heights))
    if np.ptp(heights) > 0.5 * thickness:
        raise ParameterError(
            f"the thicknesses {min(heights):.4g} to {max(heights):.4g} m are not those of one "
            "material: fit them apart."
        )
    return thickness


class _Fit:
    """The fit of some tests."""

    def __init__(self, tests: Sequence[TensileTest], options: FitOptions) -> None:
        tests = checked_list("tests", tests, TensileTest, "TensileTests, at least one", least=1)
        begun = [from_rest(test, options) for test in tests]
        tests, self.spreads = [test for test, _ in begun], [spread for _, spread in begun]
        self.options, self.samples = options, samples_of(tests, options, whole=True)
        self.remarks = [text for test in tests for text in test.remarks]
        self.doubts = [text for test in tests for text in test.doubts]
        self.scales, self.thickness = scales_of(self.samples), _thickness(tests)
        courses = self.samples.along(self.scales.stiff)
        coefficients = partial(self.scales.coefficients, course=courses)
        self._tension = partial(tension, coefficients=coefficients)
        self.curve = remembered(partial(self._at, self.samples.strain))

    def problem(self, curve: Model) -> Problem:
        """Return the fit of a model curve to the tests."""
        return self.samples.problem(curve, self.scales.bounds, self.options.loss)

    def result(self) -> FitResult:
        """Return the constants with their intervals."""
        scales, options, problem = self.scales, self.options, self.problem(self.curve)
        solution = robust_fit(problem, scales.starts)
        drawn = drawn_again(problem, solution, self.samples, options.draws, options.seed)
        drawn = np.clip(drawn + self._moved(solution, len(drawn)), *scales.bounds)
        (stress, lateral), _ = self.curve(solution.theta)
        far, near = (scales.values(end, self.thickness) for end in scales.bounds)
        return FitResult(
            estimates=estimates_of(
                scales.values(solution.theta, self.thickness),
                scales.values(drawn.T, self.thickness),
                {name: (near[name], far[name]) for name in ("c1", "c2")},
            ),
            samples=self.samples,
            stress=stress,
            lateral=lateral,
            options=options,
            thickness=self.thickness,
            stiff=scales.stiff,
            taken=self.remarks,
            doubts=self.doubts,
        )

    def _moved(self, solution: RobustFit, draws: int) -> Floats:
        """Return by how much parameters move with the origins of the tests, (draws, p)."""
        rng, found = np.random.default_rng(self.options.seed + 1), np.zeros(len(solution.theta))
        moved = np.tile(found, (draws, 1))
        for number, spread in enumerate(self.spreads):
            if spread > 1e-5 * self.scales.strain:
                by = np.where(self.samples.test == number, spread, 0.0)
                strain = np.maximum(self.samples.strain - by, 1e-9)
                curve = remembered(partial(self._at, strain))
                theta, _ = minimise(self.problem(curve), solution.theta, solution.sigma)
                moved += np.outer(rng.standard_normal(draws), theta - solution.theta)
        return moved

    def _at(self, strain: Floats, theta: Floats) -> tuple[Floats, Floats]:
        return self._tension(strain, theta=theta)
