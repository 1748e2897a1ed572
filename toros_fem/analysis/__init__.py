"""Paths of equilibria through loads and limit points, other states, and the error of a result."""

from toros_fem.analysis.arc_length import ArcLengthOptions
from toros_fem.analysis.error_estimate import ErrorEstimate, estimate_error
from toros_fem.analysis.limit_points import LimitPoint, limit_points
from toros_fem.analysis.states import FoundStates, find_states
from toros_fem.analysis.trace import trace
from toros_fem.analysis.trace_point import TracePoint

__all__ = [
    "ArcLengthOptions",
    "ErrorEstimate",
    "FoundStates",
    "LimitPoint",
    "TracePoint",
    "estimate_error",
    "find_states",
    "limit_points",
    "trace",
]
