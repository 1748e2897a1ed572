"""Relaxed designs: families of fine lines on the skin, and the printable lines made of them."""

from toros_fem.relaxed.laid_lines import LaidFamily, LaidLines, lay_lines
from toros_fem.relaxed.line_field import LineField
from toros_fem.relaxed.line_options import LineOptions

__all__ = ["LaidFamily", "LaidLines", "LineField", "LineOptions", "lay_lines"]
