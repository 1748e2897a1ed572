"""How far the shape of a design is from its target: values on any mesh of its skin."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.measures.metrics import MetricFunction
from toros_fem.measures.miss import compared_axes, is_aligned, miss_of
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.meshes.mirror import mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import make_transfer
from toros_fem.results.frames.shown_skin import ShownSkin

Values = Mapping[str, float]


def shape_measure(problem: ShapeProblem) -> Callable[[Pattern, Floats], Values] | None:
    """Return the measure of the miss of a shape, by key; None of a design that compares none.

    The measure takes a mesh of the problem's part of the skin, its own or of a `ShapeDesign` any
    other, and positions of its vertices. Values are those of the whole skin; there are none on
    another mesh of a moulded skin whose target is no function.
    """
    compared, goal_here = compared_axes(problem.objective), problem.target
    if goal_here is None or not any(compared):
        return None
    own, known = problem.skin.pattern, goal_here
    case = problem.case if isinstance(problem, ShapeDesign) else None
    aligned = is_aligned(problem.objective)

    def goal(pattern: Pattern) -> Floats | None:
        if pattern is own:
            return known
        if case is not None and callable(case.target):
            return case.target(pattern.points)
        return None if own.moulded else make_transfer(own, pattern).positions(known)

    def measure(pattern: Pattern, positions: Floats) -> Values:
        wanted = goal(pattern)
        if wanted is None:
            return {}
        planes = () if case is None else case.symmetry
        whole = problem.whole if pattern is own else mirrored(pattern, planes)
        target, shape = whole.at_vertices(wanted), whole.at_vertices(positions)
        placed = ShownSkin(whole.pattern, target, aligned).placed(shape)
        return miss_of(whole.pattern, placed, target, compared).values()

    return measure


def shape_of(made: Evaluation[Equilibrium] | None) -> dict[str, float]:
    """Return the values of the miss of a simulated print, by key (collective).

    They are empty without an equilibrium, and of a design that compares no positions.
    """
    problem = None if made is None else made.problem
    if made is None or not isinstance(problem, ShapeProblem):
        return {}
    measure = shape_measure(problem)
    if measure is None:
        return {}
    return dict(measure(problem.skin.pattern, problem.physics.shape_of(made.equilibrium)))


def quantities_of(problem: ShapeProblem, keys: list[str]) -> list[MetricFunction]:
    """Return the values of a miss, by keys, as functions of their own, for error estimates."""
    measure = shape_measure(problem)
    known: tuple[Floats | None, Values] = None, {}

    def value(key: str, pattern: Pattern, positions: Floats) -> float:
        nonlocal known
        assert measure is not None
        if known[0] is not positions:  # all values of a mesh are measured at once
            known = positions, measure(pattern, positions)
        return float(known[1].get(key, np.nan))

    return [partial(value, key) for key in keys]
