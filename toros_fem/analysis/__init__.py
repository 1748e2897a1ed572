"""Paths of equilibria, other states, wrinkles, and the error of a result."""

from toros_fem.analysis.arc_length import ArcLengthOptions
from toros_fem.analysis.error_estimate import ErrorEstimate, estimate_error
from toros_fem.analysis.holding import HoldingObjective
from toros_fem.analysis.limit_points import LimitPoint, limit_points
from toros_fem.analysis.pull_out import PullPoint, largest_force, pull_out, slip_under
from toros_fem.analysis.states import FoundStates, find_states
from toros_fem.analysis.trace import trace
from toros_fem.analysis.trace_point import TracePoint
from toros_fem.analysis.wrinkles import Tension, WrinkleField, wrinkle_field

__all__ = [
    "ArcLengthOptions",
    "ErrorEstimate",
    "FoundStates",
    "HoldingObjective",
    "LimitPoint",
    "PullPoint",
    "Tension",
    "TracePoint",
    "WrinkleField",
    "estimate_error",
    "find_states",
    "largest_force",
    "limit_points",
    "pull_out",
    "slip_under",
    "trace",
    "wrinkle_field",
]
