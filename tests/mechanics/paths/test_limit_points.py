"""Limit points between the points of a path."""

from types import SimpleNamespace

import numpy as np
import pytest

from toros_fem.mechanics.paths.trace_point import TracePoint, limit_points


def point(load_factor: float, at: float | None, rate: float | None) -> TracePoint:
    return TracePoint(0.0, np.zeros((1, 3)), {}, SimpleNamespace(), load_factor, 0, at, rate)  # type: ignore[arg-type]


def test_a_cubic_is_exact() -> None:
    """λ = s³ − 3 s turns at ±1."""
    cubic = np.poly1d([1.0, 0.0, -3.0, 0.0])
    path = [point(cubic(s), s, cubic.deriv()(s)) for s in (-1.8, -0.5, 0.2, 1.2)]
    upper, lower = limit_points(path)
    assert (upper.largest, upper.after, lower.largest, lower.after) == (True, 0, False, 2)
    assert upper.load_factor == pytest.approx(2, abs=1e-12)
    assert lower.load_factor == pytest.approx(-2, abs=1e-12)
    assert upper.fraction == pytest.approx(0.8 / 1.3)
    assert not limit_points(path[1:3])
    # A point may be a limit point itself.
    through = [point(cubic(s), s, cubic.deriv()(s)) for s in (-1.5, -1.0, -0.5)]
    (only,) = limit_points(through)
    assert (only.load_factor, only.fraction) == (2.0, 1.0)
