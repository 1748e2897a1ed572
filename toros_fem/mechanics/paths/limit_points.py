"""Limit points of a path: where its load factor turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import require_kind, shown
from toros_fem.mechanics.paths.trace_point import TracePoint


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


def limit_points(points: Sequence[TracePoint]) -> list[LimitPoint]:
    """Return the limit points of a path by arc length.

    Between two points the load factor is the cubic with its values and rates at both. The error
    falls with the fourth power of their distance.

    Raises:
        ParameterError: The path was not followed by arc length.
    """
    if not isinstance(points, list | tuple):
        raise ParameterError(
            f"points = {shown(points)} must be a list of TracePoints: list(trace(…))."
        )
    for point in points:
        require_kind("points", point, TracePoint, "TracePoints, by trace(…)")
    found = []
    for k, (one, two) in enumerate(pairwise(points)):
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
