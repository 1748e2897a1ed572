"""One equilibrium of a path."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Floats, require_kind
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver

P = TypeVar("P")


@dataclass(frozen=True, eq=False)
class TracePoint:
    """One equilibrium of a path.

    Attributes:
        pressure: Pressure in Pa; one for each chamber if there are several.
        positions: Positions of all assembled vertices in m, (n, 3).
        metrics: Values of the metrics, by key.
        result: The equilibrium.
        load_factor: Factor on the loads that act; 1 on a path by pressure.
        negative_eigenvalues: Number of negative eigenvalues of the tangent: in so many directions
            the energy falls. 0 for a stable equilibrium.
        arc_length: Length of the path up to here, a pure number; None on a path by pressure.
        load_rate: Derivative of the load factor by the arc length; None on a path by pressure.
    """

    pressure: float | list[float]
    positions: Floats
    metrics: dict[str, float]
    result: Equilibrium
    load_factor: float = 1.0
    negative_eigenvalues: int = 0
    arc_length: float | None = None
    load_rate: float | None = None

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
    positions = skin.gather_vertices(result.positions)
    values = {metric.key: metric.value(skin.pattern, positions) for metric in metrics}
    return TracePoint(pressure, positions, values, result)


def until_failure(path: Iterator[P]) -> tuple[list[P], str]:
    """Return the points of a path, and why it ends early; empty where it does not (collective)."""
    points: list[P] = []
    try:
        points.extend(path)
    except EquilibriumError as caught:  # raised by all ranks or by none
        return points, str(caught)
    return points, ""


@dataclass(frozen=True)
class LimitPoint:
    """A turn of the load factor between two points of a path.

    Attributes:
        load_factor: Its largest or smallest value there.
        largest: Whether it is a maximum.
        after: Index of the point before it.
        fraction: Place between the two points, from 0 to 1, by arc length.
    """

    load_factor: float
    largest: bool
    after: int
    fraction: float


def limit_points(points: Iterable[TracePoint]) -> list[LimitPoint]:
    """Return the limit points of a path by arc length.

    Between two points the load factor is the cubic with its values and rates at both. The error
    falls with the fourth power of their distance.
    """
    path = list(points)
    for point in path:
        require_kind("points", point, TracePoint, "TracePoints, by trace(…)")
    found = []
    for k, (one, two) in enumerate(pairwise(path)):
        rates = one.load_rate, two.load_rate
        if one.arc_length is None or two.arc_length is None or None in rates:
            raise ParameterError('limit points are known on a path by="arc-length" only.')
        step = two.arc_length - one.arc_length
        begin, end = (step * float(rate or 0.0) for rate in rates)
        if (begin > 0) == (end > 0):
            continue
        rise = two.load_factor - one.load_factor
        cubic = np.poly1d([begin + end - 2 * rise, 3 * rise - 2 * begin - end, begin, 0.0])
        # The rates have different signs, so that one root lies between, up to rounding.
        root = min(cubic.deriv().roots, key=lambda r: abs(r - 0.5))
        place = float(np.clip(root.real, 0.0, 1.0))
        found.append(LimitPoint(one.load_factor + float(cubic(place)), begin > 0, k, place))
    return found
