"""Svanberg's method of moving asymptotes, distributed over ranks."""

from toros_fem.design.mma.optimizer import MMA, MMAOptions, MMAState

__all__ = [
    "MMA",
    "MMAOptions",
    "MMAState",
]
