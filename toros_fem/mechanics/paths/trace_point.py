"""One equilibrium of a path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from toros_fem.base.array_types import Floats
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.limit_shape import limit_shape

P = TypeVar("P")


@dataclass(frozen=True, eq=False)
class TracePoint:
    """One equilibrium of a path.

    Attributes:
        pressure: Pressure in Pa; one for each chamber if there are several.
        positions: Positions of all assembled vertices in m, (n, 3), as of `limit_shape`.
        metrics: Values of the metrics, by key.
        result: The equilibrium.
        load_factor: Factor on the loads that act; 1 on a path by pressure.
        negative_eigenvalues: Number of negative eigenvalues of the tangent: in so many directions
            the energy falls. 0 for a stable equilibrium.
        arc_length: Length of the path up to here, a pure number; None on a path by pressure.
        load_rate: Derivative of the load factor by the arc length; None on a path by pressure.
        computed: Positions of all vertices in equilibrium on the mesh, (n, 3), in m; None where
            they are `positions`.
    """

    pressure: float | list[float]
    positions: Floats
    metrics: dict[str, float]
    result: Equilibrium
    load_factor: float = 1.0
    negative_eigenvalues: int = 0
    arc_length: float | None = None
    load_rate: float | None = None
    computed: Floats | None = None

    @property
    def stable(self) -> bool:
        """Whether the energy has a minimum here."""
        return self.negative_eigenvalues == 0


def measured_point(
    solver: EquilibriumSolver, result: Equilibrium, metrics: Sequence[Metric]
) -> TracePoint:
    """Return an equilibrium with its metrics, as a point of a path (collective)."""
    skin, several = solver.skin, len(result.pressures) > 1
    pressure = list(result.pressures) if several else result.pressure
    shape = limit_shape(solver, result)
    positions = shape.limit
    values = {metric.key: metric.value(skin.pattern, positions) for metric in metrics}
    return TracePoint(pressure, positions, values, result, computed=shape.computed)


def until_failure(path: Iterator[P]) -> tuple[list[P], str]:
    """Return the points of a path, and why it ends early; empty where it does not (collective)."""
    points: list[P] = []
    try:
        points.extend(path)
    except EquilibriumError as caught:  # raised by all ranks or by none
        return points, str(caught)
    return points, ""
