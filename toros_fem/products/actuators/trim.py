"""The last mile of a print: the pressure at which it is nearest to its targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.validation import require_between, require_kind
from toros_fem.design.loop.miss import worst_figure
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.measures.figures import DEFAULT, Tolerances
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium

# Largest change of the pressure, as a fraction of it.
SHARE = 0.15
# A print is trimmed while a figure is off by more than this part of its tolerance, so often at
# most; a change is tried that promises to leave at most this part of the worst figure.
ENOUGH, ROUNDS, PROMISING = 0.25, 3, 0.9
# Number of pressures at which figures are predicted.
SAMPLES = 61


def trimmed(
    printed: PrintedDesign,
    share: float = SHARE,
    tolerances: Tolerances = DEFAULT,
    *,
    designed: Sequence[float] | None = None,
) -> PrintedDesign:
    """Return a print at the pressure where its worst figure is nearest to its target (collective).

    The motion of all vertices with the logarithm of the pressure is y of K y = Σ p ∂V/∂x, by one
    solve with the tangent of the print. It predicts all figures along the pressure: angles,
    distances, directions. The print is simulated where the largest of them over its tolerance is
    least, and kept there if it is better. Pressures of several chambers keep their ratios. They
    may fall below their lower bounds, and none rises above its upper bound, or above the one that
    is prescribed.

    Args:
        printed: A print; without an equilibrium it is returned as it is.
        share: Largest change of the pressure, as a fraction of it, at most 0.9; 0 changes
            nothing.
        tolerances: How far figures may be off.
        designed: Pressures in Pa that the share is of; None takes those of the print.

    Raises:
        ParameterError: The share is out of its bounds.
    """
    require_kind("printed", printed, PrintedDesign, "the PrintedDesign of as_printed")
    require_between(0.0, 0.9, share=share)
    made = printed.evaluation
    if made is None or share == 0 or not isinstance(made.problem, ShapeProblem):
        return printed
    problem, at = made.problem, made.equilibrium.pressures
    largest = max(at, default=0.0)
    if not largest > 0:
        return printed
    moved = float(np.log(largest / max(designed))) if designed else 0.0
    lowest, highest = np.log1p(-share) - moved, np.log1p(share) - moved

    ranges = problem.physics.pressure_ranges
    for own, given, bounds in zip(at, problem.physics.pressures, ranges, strict=True):
        if own > 0:
            highest = min(highest, float(np.log((bounds[1] if bounds else given) / own)))
    least, total = worst_figure(problem, _shape(made), tolerances), 0.0
    for _ in range(ROUNDS):
        if least <= ENOUGH or not highest > lowest:
            break
        shape, motion = _shape(made), _motion(problem, made.equilibrium)
        steps = np.linspace(lowest, highest, SAMPLES) - total
        promised = [worst_figure(problem, shape + step * motion, tolerances) for step in steps]
        best = int(np.argmin(promised))
        if promised[best] > PROMISING * least:
            break
        factor = float(np.exp(steps[best]))
        try:
            other = problem.simulate_binary(
                made.projected, made, pressure=[factor * p for p in made.equilibrium.pressures]
            )
        except NoEquilibriumError:  # raised by all ranks or by none
            break
        worst = worst_figure(problem, _shape(other), tolerances)
        if worst >= least:
            break
        made, least, total = other, worst, total + float(steps[best])
    return replace(printed, evaluation=made)


def worst_of_print(printed: PrintedDesign, tolerances: Tolerances = DEFAULT) -> float:
    """Return the largest distance of a figure of a print from its target, over its tolerance.

    It is infinite without an equilibrium (collective).
    """
    made = printed.evaluation
    if made is None or not isinstance(made.problem, ShapeProblem):
        return np.inf
    return worst_figure(made.problem, _shape(made), tolerances)


def _shape(made: Evaluation[Equilibrium]) -> Floats:
    found = made.problem.physics.shape_of(made.equilibrium)
    assert found is not None
    return found


def _motion(problem: ShapeProblem, at: Equilibrium) -> Floats:
    """Return the derivative of all vertices by the logarithm of the pressures, (n, 3)."""
    solver = problem.solver
    solver.tangent_at(at)
    push = np.zeros_like(at.state)
    for chamber, pressure in enumerate(at.pressures):
        push += pressure * solver.model.volume_gradient(at.state, chamber)
    return problem.skin.gather_vertices(solver.model.positions(solver.solve_tangent(push, at)))
