"""The print of a design, simulated again."""

from toros_fem.making.as_printed.as_printed import (
    PrintedDesign,
    as_printed,
    connect_islands,
    remove_islands,
)
from toros_fem.making.as_printed.printed_lines import clean_print, printed_lines

__all__ = [
    "PrintedDesign",
    "as_printed",
    "clean_print",
    "connect_islands",
    "printed_lines",
    "remove_islands",
]
