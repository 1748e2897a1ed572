"""Relaxed designs: shares and directions of fine lines in each triangle as variables."""

from toros_fem.design.relaxed.find import RelaxedOptions, RelaxedResult, find_lines

__all__ = [
    "RelaxedOptions",
    "RelaxedResult",
    "find_lines",
]
