"""Relaxed designs: families of fine lines on the skin, and the printable lines made of them."""

from toros_fem.relaxed.line_field import LineField
from toros_fem.relaxed.line_options import LineOptions

__all__ = ["LineField", "LineOptions"]
