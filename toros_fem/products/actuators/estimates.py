"""Errors of what a run tells of a print: half-widths of intervals, from coarser meshes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.mpi import free_dropped
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.readings.error_estimate import LimitShape, limit_shape
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.other_mesh import Printed, coarser_levels, simulated_on
from toros_fem.results.shape_miss import shape_of

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import Level

# Ratio of edge lengths of two meshes whose difference tells an error.
COARSER = 1.5

Measures = Mapping[str, Callable[[Pattern, Floats], float]]


@dataclass(frozen=True)
class MetricErrors:
    """How far metrics may be off because of their mesh.

    Attributes:
        computed: Values of the equilibrium on its mesh, by key; those that are told are its limit.
        other_meshes: Those that would be told on other meshes, by the ratio of their edge lengths:
            below 1 on a finer one. Empty where there is none.
        intervals: Half-width of the interval of each, by key.
        failure: Why there is nothing to compare with; None if there is.
        seconds: Wall time.
    """

    computed: Mapping[str, float]
    other_meshes: Mapping[float, Mapping[str, float]] = field(default_factory=dict)
    intervals: Mapping[str, float] = field(default_factory=dict)
    failure: str | None = None
    seconds: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return it as summaries hold it; the intervals are with the figures."""
        return {name: value for name, value in asdict(self).items() if name != "intervals"}

    @property
    def words(self) -> str:
        """Why errors are unknown, in words; empty if they are known."""
        return "" if self.failure is None else "nothing to compare with, so that errors are unknown"


def metric_errors(
    job: Job,
    level: Level,
    shape: LimitShape,
    measures: Measures,
    printed: Printed | None,
    pressures: Sequence[float] | None,
) -> MetricErrors:
    """Return the errors of measures of a print, from the same print on other meshes (collective).

    With a finer mesh the interval is that of the finer one, and how far what is told lies from it.

    Args:
        job: What was printed.
        level: The mesh of the print.
        shape: Its shape.
        measures: Functions of a pattern and the positions of its vertices, by key: metrics, and
            what the shape misses.
        printed: The print; None for a skin without one.
        pressures: Pressure of each chamber in Pa; None takes those of the scene.
    """
    begin, scene = time.perf_counter(), job.scene
    computed = {key: measure(shape.pattern, shape.computed) for key, measure in measures.items()}
    told: dict[float, dict[str, float]] = {}
    failure, near, finest = None, (shape.pattern, shape.computed), shape
    try:
        others = coarser_levels(scene, level)
    except ParameterError as caught:  # raised by all ranks or by none, as below
        others, failure = {}, str(caught)
    if scene.results.check_refinement is not None:
        ratio, finer = scene.finer(level, scene.results.check_refinement)
        others[ratio] = finer
    for ratio, other in others.items():
        try:
            made = simulated_on(job, other, near, printed, pressures)
        except (ParameterError, NoEquilibriumError) as caught:
            failure = failure or str(caught)
        else:
            told[ratio], other_shape = _told(made)
            finest = other_shape if ratio < 1 else finest
            del made
        free_dropped(job.comm)
    if not told:
        return MetricErrors(computed, failure=failure)
    intervals = {
        key: width
        for key, measure in measures.items()
        if (width := _half_width(key, measure, shape, finest, told)) is not None
    }
    return MetricErrors(computed, told, intervals, seconds=time.perf_counter() - begin)


def _half_width(
    key: str,
    measure: Callable[[Pattern, Floats], float],
    shape: LimitShape,
    finest: LimitShape,
    told: Mapping[float, Mapping[str, float]],
) -> float | None:
    """Return the half-width of a measure of a shape; None where other meshes do not tell it."""
    values = {r: own[key] for r, own in told.items() if np.isfinite(own.get(key, np.nan))}
    coarser = {r: value for r, value in values.items() if r > 1}
    best = measure(finest.pattern, finest.limit)
    if finest is shape or not np.isfinite(best):
        return shape.interval(measure, coarser) if coarser else None
    own, ratio = measure(shape.pattern, shape.limit), min(told)
    others = {r / ratio: value for r, value in ({1.0: own} | coarser).items()}
    return abs(own - best) + finest.interval(measure, others)


def _told(made: Evaluation[Equilibrium]) -> tuple[dict[str, float], LimitShape]:
    problem = made.problem
    assert isinstance(problem, ShapeDesign)
    values = {**problem.metrics_of(made.equilibrium), **shape_of(made)}
    return values, limit_shape(problem.solver, made.equilibrium)
