"""The print of a design: contours, widths, islands, printability."""

from toros_fem.making.print.cleaning import CleanedRegions, clean
from toros_fem.making.print.contours import panel_outline, printed_regions
from toros_fem.making.print.printability import (
    Printability,
    PrintLimits,
    printability,
    printed_cells,
)
from toros_fem.making.print.regions import mirrored_regions, regions_on

__all__ = [
    "CleanedRegions",
    "PrintLimits",
    "Printability",
    "clean",
    "mirrored_regions",
    "panel_outline",
    "printability",
    "printed_cells",
    "printed_regions",
    "regions_on",
]
