"""Equilibria along a path of pressures, and the discretisation error of a result."""

from toros_fem.analysis.error_estimate import ErrorEstimate, estimate_error
from toros_fem.analysis.pressure_path import PressurePathPoint, trace_pressure_path
from toros_fem.analysis.states import FoundStates, find_states

__all__ = [
    "ErrorEstimate",
    "FoundStates",
    "PressurePathPoint",
    "estimate_error",
    "find_states",
    "trace_pressure_path",
]
