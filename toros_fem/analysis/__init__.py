"""Equilibria along a path of pressures, and the discretisation error of a result."""

from toros_fem.analysis.error_estimate import ErrorEstimate, estimate_error
from toros_fem.analysis.pressure_path import PressurePathPoint, trace_pressure_path

__all__ = ["ErrorEstimate", "PressurePathPoint", "estimate_error", "trace_pressure_path"]
