"""Errors of what a run tells of a print: half-widths of intervals, from other meshes."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError, TorosError
from toros_fem.base.mpi import free_dropped
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.measures.figures import Figure
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.readings.error_estimate import LimitShape, half_width, limit_shape
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.other_mesh import Printed, coarser_levels, simulated_on
from toros_fem.results.shape_miss import quantities_of, shape_of

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import ActuatorScene, Level

log = logging.getLogger(__name__)

# Ratio of edge lengths of two meshes whose difference tells an error.
COARSER = 1.5

Measures = Mapping[str, Callable[[Pattern, Floats], float]]
# Simulates a print on the mesh of a scene's `TRIAL_MESH`.
OnOtherMesh = Callable[[], Evaluation[Equilibrium]]


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
    told: dict[float, Mapping[str, float]] = {}
    own = {1.0: {key: shape.half_width(measure) for key, measure in measures.items()}}
    failure, near = None, (shape.pattern, shape.computed)
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
        except TorosError as caught:
            failure = failure or str(caught)
            if ratio < 1 and job.comm.rank == 0:
                log.warning("the check on a finer mesh is left out: %s", caught)
        else:
            told[ratio] = _told(made)
            if ratio < 1:
                own[ratio] = _half_widths(made, [*measures])
            del made
        free_dropped(job.comm)
    if not told:
        return MetricErrors(computed, failure=failure)
    here = {1.0: {key: measure(shape.pattern, shape.limit) for key, measure in measures.items()}}
    widths = {key: _interval(_finite(here | told, key), _finite(own, key)) for key in measures}
    intervals = {key: width for key, width in widths.items() if width is not None}
    return MetricErrors(computed, told, intervals, seconds=time.perf_counter() - begin)


def _finite(tables: Mapping[float, Mapping[str, float]], key: str) -> dict[float, float]:
    """Return a value of each mesh; a target may be unknown on some."""
    values = {ratio: table.get(key, np.nan) for ratio, table in tables.items()}
    return {ratio: value for ratio, value in values.items() if np.isfinite(value)}


def _interval(values: Mapping[float, float], own: Mapping[float, float]) -> float | None:
    """Return the half-width around the value of the mesh 1; None where no other mesh tells one.

    It is that of the finest mesh, from the coarser ones, and how far the value lies from there.

    Args:
        values: Of each mesh, by its edge length over that of the print's mesh.
        own: Parts of half-widths that meshes tell on their own.
    """
    if 1.0 not in values.keys() & own.keys():
        return None
    finest = min(values.keys() & own.keys())
    best = values[finest]
    changes = {r / finest: abs(value - best) for r, value in values.items() if r > finest}
    return abs(values[1.0] - best) + half_width(own[finest], changes) if changes else None


def trial_intervals(
    comm: MPI.Comm,
    scene: ActuatorScene,
    figures: Sequence[Figure],
    other: OnOtherMesh | None,
    own: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return half-widths of the intervals of a trial's figures, by their keys (collective).

    The trial is repeated on another mesh; None leaves intervals out. `own` are parts of them that
    a trial tells on its own.
    """
    if other is None:
        return {}
    free_dropped(comm)
    try:
        there = {figure.key: figure.value for figure in scene.trial_figures(comm, other())}
    except TorosError as caught:  # raised by all ranks or by none
        if comm.rank == 0:
            log.warning("the repeated trial, and with it intervals, is left out: %s", caught)
        return {}
    finally:
        free_dropped(comm)
    found: dict[str, float] = {}
    for figure in figures:
        one, two = figure.value, there.get(figure.key)
        if one is not None and two is not None:
            part = (own or {}).get(figure.key, 0.0)
            parts = {1.0: part, scene.TRIAL_MESH: part}
            width = _interval({1.0: one, scene.TRIAL_MESH: two}, parts)
            found |= {} if width is None else {figure.key: width}
    return found


def measures_of(problem: ShapeDesign, keys: Sequence[str]) -> Measures:
    """Return the metrics of a problem, and the values of its miss with these keys."""
    metrics = {metric.key: metric.measure for metric in problem.metrics}
    missed = [key for key in keys if key not in metrics]
    return metrics | dict(zip(missed, quantities_of(problem, missed), strict=True))


def _told(made: Evaluation[Equilibrium]) -> dict[str, float]:
    return {**made.problem.metrics_of(made.equilibrium), **shape_of(made)}


def _half_widths(made: Evaluation[Equilibrium], keys: Sequence[str]) -> dict[str, float]:
    """Return the part of each half-width that a mesh tells on its own."""
    problem = made.problem
    assert isinstance(problem, ShapeDesign)
    shape = limit_shape(problem.solver, made.equilibrium)
    return {key: shape.half_width(m) for key, m in measures_of(problem, keys).items()}
