"""Errors of what a run tells of a print: half-widths of intervals, from two elements."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from toros_fem.base.array_types import Floats
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.limit_shape import limit_shape
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True)
class MetricErrors:
    """How far metrics may be off because of their mesh.

    Attributes:
        computed: Values of the equilibrium on its mesh, by key; those that are told are its limit.
        intervals: Half-width of the interval of each, by key.
        seconds: Wall time.
    """

    computed: Mapping[str, float]
    intervals: Mapping[str, float] = field(default_factory=dict)
    seconds: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return it as summaries hold it; the intervals are with the figures."""
        return {name: value for name, value in asdict(self).items() if name != "intervals"}


def metric_errors(
    solver: EquilibriumSolver,
    at: Equilibrium,
    measures: Mapping[str, Callable[[Pattern, Floats], float]],
) -> MetricErrors:
    """Return the errors of measures of a print with smoothed strains, as of `limit_shape`.

    Args:
        solver: The solver of the print.
        at: The equilibrium.
        measures: Functions of a pattern and the positions of its vertices, by key (collective).
    """
    begin = time.perf_counter()
    shape = limit_shape(solver, at)
    return MetricErrors(
        {key: measure(shape.pattern, shape.computed) for key, measure in measures.items()},
        {key: shape.half_width(measure) for key, measure in measures.items()},
        time.perf_counter() - begin,
    )
