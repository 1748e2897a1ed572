"""Errors of a print's metrics, from a finer or a coarser mesh."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.measures.metrics import Metric, MetricFunction
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.error_estimate import estimate_error
from toros_fem.products.actuators.discovery import Discovery
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.line_print import print_of_lines
from toros_fem.results.shape_miss import shape_of

# Order of convergence that the errors of laid lines are estimated with. On the nets and twisting
# lines of docs/manufacture.md, edges twice as long changed a figure by 3 to 18 times its error.
ORDER_OF_LINES = 1.5


@dataclass(frozen=True)
class MetricErrors:
    """How far metrics may be off because of their mesh.

    Attributes:
        mesh: The mesh that they are compared with, "refined" or "coarser".
        metrics: The metrics on it, by key; empty where they cannot be compared.
        intervals: Half-width of the interval of each metric, by key.
        failure: Why they cannot be compared; None if they can.
        seconds: Wall time.
    """

    mesh: str
    metrics: Mapping[str, float] = field(default_factory=dict)
    intervals: Mapping[str, float] = field(default_factory=dict)
    failure: str | None = None
    seconds: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return it as summaries hold it; the intervals are with the figures."""
        return {name: value for name, value in asdict(self).items() if name != "intervals"}

    @property
    def words(self) -> str:
        """What there was nothing to compare with, in words; empty if there was."""
        if self.failure is None:
            return ""
        return f"nothing to compare with on a {self.mesh} mesh, so that its error is unknown"


def errors_by_refinement(
    solver: EquilibriumSolver,
    result: Equilibrium,
    metrics: Sequence[Metric],
    more: Mapping[str, MetricFunction] | None = None,
) -> MetricErrors:
    """Return the errors of metrics, from a refined mesh (collective).

    Args:
        solver: The solver on the given mesh.
        result: The equilibrium.
        metrics: The metrics.
        more: Further numbers by key.
    """
    measures = {**{metric.key: metric.measure for metric in metrics}, **(more or {})}
    if not measures:
        return MetricErrors("refined")
    try:
        found = estimate_error(solver, result, list(measures.values()), direct=True)
    except EquilibriumError as caught:  # raised by all ranks or by none
        return MetricErrors("refined", failure=str(caught))
    known = {key: one for key, one in zip(measures, found, strict=True) if np.isfinite(one.error)}
    return MetricErrors(
        "refined",
        {key: one.refined for key, one in known.items()},
        {key: one.error for key, one in known.items()},
        seconds=found[0].seconds,
    )


def errors_of_lines(
    job: Job, found: Discovery, shape: Mapping[str, float] | None = None
) -> MetricErrors:
    """Return the errors of the metrics of laid lines, from a coarser mesh (collective).

    The mesh of a print of lines is so fine already that a refined one would take longer than the
    design.

    Args:
        job: What was designed.
        found: Its lines.
        shape: How far their shape is from the target, as of `Miss.values`; None for nothing.
    """
    begin, made = time.perf_counter(), found.made.printed.evaluation
    fine = {**found.best.metrics, **(shape or {})}
    assert made is not None
    once = replace(job, journal=None, verbose=False)
    try:
        ratio, level = job.scene.coarser_print_level()
        plain, pressures = job.scene.case(job.comm, level), made.equilibrium.pressures
        other = print_of_lines(once, level, plain, found.best.laid, found.made.shape, pressures)
    except ParameterError as caught:  # there is no coarser mesh
        return MetricErrors("coarser", failure=str(caught))
    coarse = {**other.metrics, **shape_of(other.problem, other.printed.evaluation)}
    if not coarse:
        return MetricErrors("coarser", failure=other.printed.failure)
    caution = 1 / (ratio**ORDER_OF_LINES - 1)
    errors = {
        key: caution * abs(value - coarse[key]) for key, value in fine.items() if key in coarse
    }
    return MetricErrors("coarser", coarse, errors, seconds=time.perf_counter() - begin)
