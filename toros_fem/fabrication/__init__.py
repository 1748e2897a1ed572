"""The print of a design: contours, widths, islands, printability, drawing, and its simulation."""

from toros_fem.fabrication.as_printed import (
    PrintedDesign,
    as_printed,
    connect_islands,
    remove_islands,
)
from toros_fem.fabrication.cleaning import CleanedRegions, clean
from toros_fem.fabrication.contours import panel_outline, printed_regions
from toros_fem.fabrication.printability import (
    Printability,
    PrintLimits,
    printability,
    printed_cells,
)
from toros_fem.fabrication.printed_lines import clean_print, printed_lines
from toros_fem.fabrication.regions import mirrored_regions, regions_on
from toros_fem.fabrication.svg import write_svg

__all__ = [
    "CleanedRegions",
    "PrintLimits",
    "Printability",
    "PrintedDesign",
    "as_printed",
    "clean",
    "clean_print",
    "connect_islands",
    "mirrored_regions",
    "panel_outline",
    "printability",
    "printed_cells",
    "printed_lines",
    "printed_regions",
    "regions_on",
    "remove_islands",
    "write_svg",
]
