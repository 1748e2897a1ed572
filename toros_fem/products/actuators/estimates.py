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
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.readings.error_estimate import LimitShape
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
        coarser: Those that would be told on coarser meshes, by the ratio of their edge lengths;
            empty where there is none.
        intervals: Half-width of the interval of each, by key.
        failure: Why there is nothing to compare with; None if there is.
        seconds: Wall time.
    """

    computed: Mapping[str, float]
    coarser: Mapping[float, Mapping[str, float]] = field(default_factory=dict)
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
    """Return the errors of measures of a print, from the same print on coarser meshes (collective).

    Args:
        job: What was printed.
        level: The mesh of the print.
        shape: Its shape.
        measures: Functions of a pattern and the positions of its vertices, by key: metrics, and
            what the shape misses.
        printed: The print; None for a skin without one.
        pressures: Pressure of each chamber in Pa; None takes those of the scene.
    """
    begin = time.perf_counter()
    computed = {key: measure(shape.pattern, shape.computed) for key, measure in measures.items()}
    coarser: dict[float, dict[str, float]] = {}
    failure, near = None, (shape.pattern, shape.computed)
    try:
        others = coarser_levels(job.scene, level)
    except ParameterError as caught:  # raised by all ranks or by none, as below
        return MetricErrors(computed, failure=str(caught))
    for ratio, other in others.items():
        try:
            coarser[ratio] = _told(simulated_on(job, other, near, printed, pressures))
        except (ParameterError, NoEquilibriumError) as caught:
            failure = failure or str(caught)
        free_dropped(job.comm)
    if not coarser:
        return MetricErrors(computed, failure=failure)
    intervals = {}
    for key, measure in measures.items():
        values = {r: told[key] for r, told in coarser.items() if np.isfinite(told.get(key, np.nan))}
        if values:
            intervals[key] = shape.interval(measure, values)
    return MetricErrors(computed, coarser, intervals, seconds=time.perf_counter() - begin)


def _told(made: Evaluation[Equilibrium]) -> dict[str, float]:
    return {**made.problem.metrics_of(made.equilibrium), **shape_of(made)}
