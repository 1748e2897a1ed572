"""How far a design's shape is from its targets, on any mesh: figures, and residuals of lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign, ShapeProblem
from toros_fem.measures.cross_sections import COUNTS, CrossSections, Rod, rod_of
from toros_fem.measures.figures import DEFAULT, TOLERANCE, Tolerances, largest_part
from toros_fem.measures.metrics import MetricFunction
from toros_fem.measures.miss import compared_axes, is_aligned, miss_of, placed_on, shape_figures
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.meshes.pattern import Pattern, mirrored
from toros_fem.meshes.transfer import make_transfer

# Angle in rad that the direction of a body's tip may be off.
DIRECTION = np.radians(DEFAULT.direction)

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
        if aligned:
            shape = placed_on(whole.pattern, shape, target)
        return miss_of(whole.pattern, shape, target, compared).values()

    return measure


def shape_of(made: Evaluation[Equilibrium] | None) -> dict[str, float]:
    """Return the values of the miss of a simulated print, by key (collective).

    They are empty without an equilibrium, and of a design that compares no positions. The name of
    a further pose comes before its keys.
    """
    found: dict[str, float] = {}
    for one in () if made is None else made.every:
        problem = one.problem
        if isinstance(problem, ShapeProblem) and (measure := shape_measure(problem)) is not None:
            values = measure(problem.skin.pattern, problem.physics.shape_of(one.equilibrium))
            found |= {f"{prefix_of(problem)}{key}": value for key, value in values.items()}
    return found


def prefix_of(problem: DesignProblem[Equilibrium]) -> str:
    """Return what comes before the keys of a problem: the name of a further pose, or nothing."""
    name = problem.case.name if isinstance(problem, ShapeDesign) else None
    return "" if name is None else f"{name}_"


def quantities_of(problem: ShapeProblem, keys: list[str]) -> list[MetricFunction]:
    """Return the values of a miss, by keys, as functions of their own, for error estimates."""
    measure, prefix = shape_measure(problem), prefix_of(problem)
    known: tuple[Floats | None, Values] = None, {}

    def value(key: str, pattern: Pattern, positions: Floats) -> float:
        nonlocal known
        assert measure is not None
        if known[0] is not positions:  # all values of a mesh are measured at once
            known = positions, measure(pattern, positions)
        return float(known[1].get(key.removeprefix(prefix), np.nan))

    return [partial(value, key) for key in keys]


def worst_figure(
    problem: ShapeProblem, positions: Floats, tolerances: Tolerances = DEFAULT
) -> float:
    """Return the largest distance of a figure of a shape from its target, over its tolerance.

    Figures are those of metrics and of the miss, at positions of all vertices, (n, 3), in m.
    """
    pattern, measure = problem.skin.pattern, shape_measure(problem)
    figures = [
        metric.figure(metric.value(pattern, positions), None, tolerances.figure)
        for metric in problem.metrics
    ]
    if measure is not None:
        figures += shape_figures(measure(pattern, positions), {}, tolerances)
    return largest_part(figures)


class Aim(NamedTuple):
    """Target of a metric, and the distance from it that counts as 1."""

    target: float
    scale: float


@dataclass(frozen=True, eq=False)
class Residuals:
    """The vector r of a shape, by whose derivatives lines are changed.

    Its entries are smooth, over tolerances: what metrics are from their targets, and where
    cross-sections count, their centres, and the direction of the tip.

    Attributes:
        case: The skin, on the mesh of the shape.
        aims: Targets of its metrics, by key.
        labels: Cross-section of each vertex of the whole skin, (n,), −1 for none; None where none
            count.
        compared: Whether their positions along x, y and z count.
    """

    case: Case
    aims: Mapping[str, Aim]
    labels: Ints | None
    compared: Bools

    def rod(self, positions: Floats) -> Rod:
        """Return the cross-sections of a shape, from positions of all vertices, (n, 3), in m."""
        assert self.labels is not None
        whole = self.case.whole
        return rod_of(whole.pattern, self.labels, whole.at_vertices(positions))

    def __call__(self, positions: Floats) -> Floats:
        """Return r, (j,), from positions of all vertices, (n, 3), in m."""
        parts = [self._of_metrics(positions)]
        if self.labels is not None:
            off, turned = self._of_shape(positions)
            parts += [off.ravel() / np.sqrt(len(off)), turned]
        return np.concatenate(parts)

    def of_metrics(self, positions: Floats) -> float:
        """Return the largest miss of a metric, over its target, or its scale if that is more."""
        return TOLERANCE * float(np.abs(self._of_metrics(positions)).max(initial=0.0))

    def of_shape(self, positions: Floats) -> float:
        """Return the root mean square miss of the centres over the length, or that of the tip.

        The direction of the tip counts as `TOLERANCE` where it is off by `DIRECTION`. Without
        cross-sections there is none, 0.
        """
        if self.labels is None:
            return 0.0
        off, turned = self._of_shape(positions)
        rms = float(np.sqrt((off**2).sum(axis=1).mean()))
        return TOLERANCE * max(rms, float(np.linalg.norm(turned)))

    def _of_metrics(self, positions: Floats) -> Floats:
        pattern, metrics = self.case.pattern, {m.key: m for m in self.case.judged}
        off = [
            (metrics[key].value(pattern, positions) - aim.target) / max(abs(aim.target), aim.scale)
            for key, aim in self.aims.items()
        ]
        return np.array(off) / TOLERANCE

    def _of_shape(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return the misses of the centres, (k, 3), and of the tip's direction, (3,)."""
        goal, rod = self.rod(self.case.goal), self.rod(positions)
        length = float(np.ptp(self.case.pattern.points, axis=0).max())
        off = (rod.centres - goal.centres) * self.compared / (TOLERANCE * length)
        way = rod.rest[-1] - rod.rest[0]
        turned = (rod.frames[-1] - goal.frames[-1]) @ (way / np.linalg.norm(way)) / DIRECTION
        return np.asarray(off), np.asarray(turned)


def residuals_of(case: Case) -> Residuals:
    """Return the residuals of shapes of a case.

    Cross-sections count where they are a part of the objective, and their places in it.
    """
    part = next((part for part in case.parts if isinstance(part, CrossSections)), None)
    weights = np.zeros(3) if part is None else part.position_weights.sum(axis=0)
    compared = weights >= COUNTS
    labels = part.labels if part is not None and compared.any() else None
    aims = {
        m.key: Aim(m.target, m.scale or abs(m.target) or 1.0)
        for m in case.judged
        if m.target is not None
    }
    return Residuals(case, aims, labels, compared)
