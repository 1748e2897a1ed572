"""Paths of equilibria, through limit points too, and other states."""

from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.paths.limit_points import LimitPoint, limit_points
from toros_fem.mechanics.paths.load_path import LoadPath, LoadStep, PathGradient
from toros_fem.mechanics.paths.pull_out import PullPoint, largest_force, pull_out, slip_under
from toros_fem.mechanics.paths.states import FoundStates, find_states
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint

__all__ = [
    "ArcLengthOptions",
    "FoundStates",
    "LimitPoint",
    "LoadPath",
    "LoadStep",
    "PathGradient",
    "PullPoint",
    "TracePoint",
    "find_states",
    "largest_force",
    "limit_points",
    "pull_out",
    "slip_under",
    "trace",
]
