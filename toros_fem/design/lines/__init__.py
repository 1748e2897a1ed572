"""Printable lines of a width along directions on the skin, joined across its seams."""

from toros_fem.design.lines.field import LineField
from toros_fem.design.lines.laid_lines import LaidFamily, LaidLines, widened
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.design.lines.options import LineOptions

__all__ = [
    "LaidFamily",
    "LaidLines",
    "LineField",
    "LineOptions",
    "lay_lines",
    "widened",
]
