"""Errors of a print's metrics, from a finer or a coarser mesh, as entries of the summary."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.solver import (
    EquilibriumError,
    EquilibriumResult,
    EquilibriumSolver,
)
from toros_fem.mechanics.readings.error_estimate import estimate_error
from toros_fem.products.actuators.discovery import Discovery, metrics_on_coarser_mesh

if TYPE_CHECKING:  # errors of a scene's print
    from toros_fem.products.actuators.scene import ActuatorScene

# Order of convergence that the errors of laid lines are estimated with. On the nets and twisting
# lines of docs/manufacture.md, edges twice as long changed a figure by 3 to 18 times its error.
ORDER_OF_LINES = 1.5


def error_figures(
    solver: EquilibriumSolver,
    density: Floats,
    result: EquilibriumResult,
    metrics: Sequence[Metric],
) -> dict[str, Any]:
    """Return each metric on a refined mesh and its estimated error, by key (collective).

    All are None if the refined mesh has no equilibrium near that of the given one; the key
    "refined" then says why. "error_seconds" is the wall time that this took.

    Args:
        solver: The solver on the given mesh.
        density: Density of this rank's triangles.
        result: Their equilibrium.
        metrics: The metrics.
    """
    if not metrics:
        return {}
    try:
        found = estimate_error(solver, density, result, [m.measure for m in metrics], direct=True)
    except EquilibriumError as caught:  # raised by all ranks or by none
        keys = [f"{m.name}_{kind}_{m.unit}" for m in metrics for kind in ("refined", "error")]
        return {**dict.fromkeys(keys), "refined": str(caught)}
    figures: dict[str, Any] = {"error_seconds": found[0].seconds}
    for metric, estimate in zip(metrics, found, strict=True):
        figures[f"{metric.name}_refined_{metric.unit}"] = estimate.refined
        figures[f"{metric.name}_error_{metric.unit}"] = estimate.error
    return figures


def error_of_lines(comm: MPI.Comm, scene: ActuatorScene, found: Discovery) -> dict[str, Any]:
    """Return each metric of laid lines on a coarser mesh and its estimated error (collective).

    The mesh of a print of lines is so fine already that a refined one would take longer than the
    design. All are None if there is no coarser mesh, or no equilibrium on it; the key "coarser"
    then says why.
    """
    metrics, begin = found.problem.metrics, time.perf_counter()
    try:
        ratio, other = metrics_on_coarser_mesh(comm, scene, found)
    except (NoEquilibriumError, ParameterError) as caught:  # raised by all ranks or by none
        keys = [f"{m.name}_{kind}_{m.unit}" for m in metrics for kind in ("coarser", "error")]
        return {**dict.fromkeys(keys), "coarser": str(caught)}
    figures: dict[str, Any] = {"error_seconds": time.perf_counter() - begin}
    caution = 1 / (ratio**ORDER_OF_LINES - 1)
    for metric in metrics:
        value, coarser = found.best.metrics[metric.key], other[metric.key]
        figures[f"{metric.name}_coarser_{metric.unit}"] = coarser
        figures[f"{metric.name}_error_{metric.unit}"] = caution * abs(value - coarser)
    return figures
