"""`fit_material`: material constants of eq. (1) from tensile tests."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import require_kind
from toros_fem.materials.sheet import Material
from toros_fem.products.fitting.intervals import bootstrap_draws, hessian_draws
from toros_fem.products.fitting.origin import from_rest
from toros_fem.products.fitting.parameters import scales_of
from toros_fem.products.fitting.result import FitResult, estimates_of
from toros_fem.products.fitting.robust_fit import (
    Model,
    Problem,
    Solution,
    minimise,
    remembered,
    robust_fit,
)
from toros_fem.products.fitting.samples import checked_tests, samples_of
from toros_fem.products.fitting.strip import ClampedStrip
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.fitting.uniaxial import tension
from toros_fem.products.options import FitOptions

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
        FileError: There is no test, a test has too few points, thicknesses differ, or
            directions are not those of one fabric.
    """
    options = FitOptions() if options is None else options
    require_kind("options", options, FitOptions, "FitOptions, or None")
    fit = _Fit(tests, options)
    if strip is None:
        return fit.result(fit.free, robust_fit(fit.problem(fit.free), fit.scales.starts))
    require_kind("strip", strip, ClampedStrip, "a ClampedStrip, or None")
    return fit.clamped(strip)


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
    """The fit of some tests, by strips that narrow freely or between clamps."""

    def __init__(self, tests: Sequence[TensileTest], options: FitOptions) -> None:
        begun = [from_rest(test, options) for test in checked_tests(tests)]
        tests, self.spreads = [one.test for one in begun], [one.spread for one in begun]
        self.options, self.samples = options, samples_of(tests, options, whole=True)
        self.remarks = [text for test in tests for text in test.remarks]
        self.doubts = [text for test in tests for text in test.doubts]
        self.scales, self.thickness = scales_of(self.samples), _thickness(tests)
        courses = self.samples.along(self.scales.stiff)
        coefficients = partial(self.scales.coefficients, course=courses)
        self._tension = partial(tension, coefficients=coefficients)
        self.free = remembered(partial(self._at, self.samples.strain))

    def problem(self, curve: Model) -> Problem:
        """Return the fit of a model curve to the tests."""
        return self.samples.problem(curve, self.scales.bounds, self.options.loss)

    def clamped(self, strip: ClampedStrip) -> FitResult:
        """Fit and simulate in turns (collective)."""
        top, curve, starts = np.abs(self.samples.stress).max(), self.free, self.scales.starts
        for rounds in range(1, MOST_ROUNDS + 1):
            solve = partial(robust_fit, self.problem(curve), starts)
            solution = on_first_rank(strip.comm, solve)
            before, starts = curve(solution.theta)[0][0], [solution.theta]
            curve = self._between_clamps(strip, solution.theta)
            change = np.abs(curve(solution.theta)[0][0] - before).max() / top
            if change <= SAME:
                found = partial(self.result, curve, solution, rounds)
                return on_first_rank(strip.comm, found)
        raise FileError(
            f"after {MOST_ROUNDS} rounds fit and simulated strip still differ by {change:.1%} of "
            "the largest stress. Fit fewer data by up_to."
        )

    def _between_clamps(self, strip: ClampedStrip, theta: Floats) -> Model:
        """Return the curve of free strips with what clamps change at some parameters."""
        values = self.scales.values(theta, self.thickness)
        ratio = max(values.get("knit_ratio", 1.0), 1.0)
        young, poisson, c1, c2 = (values[name] for name in ("young", "poisson", "c1", "c2"))
        sheet = Material(young, poisson, self.thickness, c1, c2)
        factor, shift = np.ones((2, len(self.samples.strain))), 0.0 * self.samples.strain
        for name in dict.fromkeys(self.samples.direction):
            rows = self.samples.along(name)
            way = "course" if name == self.scales.stiff else "wale"
            factor[0, rows], shift[rows] = strip.correction(
                sheet, self.samples.strain[rows], knit_ratio=ratio, direction=way
            )

        def curve(theta: Floats) -> tuple[Floats, Floats]:
            free, slopes = self.free(theta)
            return factor * free + [0 * shift, shift], factor[:, :, None] * slopes

        return curve

    def result(self, curve: Model, solution: Solution, rounds: int = 0) -> FitResult:
        """Return the result of a fit, with its intervals."""
        scales, options, problem = self.scales, self.options, self.problem(curve)
        solution = Solution(solution.theta, solution.sigma, *problem.model(solution.theta))
        if options.intervals == "bootstrap":
            drawn = bootstrap_draws(problem, solution, self.samples, options.draws, options.seed)
        else:
            drawn = hessian_draws(problem, solution, max(options.draws, 4000), options.seed)
        drawn = np.clip(drawn + self._moved(solution, len(drawn)), *scales.bounds)
        (stress, lateral), _ = curve(solution.theta)
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
            rounds=rounds,
            taken=self.remarks,
            doubts=self.doubts,
        )

    def _moved(self, solution: Solution, draws: int) -> Floats:
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
