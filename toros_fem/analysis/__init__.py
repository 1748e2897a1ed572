"""Paths of equilibria, other states, wrinkles, and the error of a result."""

from toros_fem.analysis.arc_length import ArcLengthOptions
from toros_fem.analysis.error_estimate import ErrorEstimate, estimate_error
from toros_fem.analysis.limit_points import LimitPoint, limit_points
from toros_fem.analysis.states import FoundStates, find_states
from toros_fem.analysis.trace import trace
from toros_fem.analysis.trace_point import TracePoint
from toros_fem.analysis.wrinkles import Tension, WrinkleField, wrinkle_field

__all__ = [
    "ArcLengthOptions",
    "ErrorEstimate",
    "FoundStates",
    "LimitPoint",
    "Tension",
    "TracePoint",
    "WrinkleField",
    "estimate_error",
    "find_states",
    "limit_points",
    "trace",
    "wrinkle_field",
]
