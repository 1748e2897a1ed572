"""What goes to the workshop: all machine files of a design on sheets, their manifest and page."""

from toros_fem.workshop.reading import read_regions
from toros_fem.workshop.sewing_order import SewingStep, sewing_order
from toros_fem.workshop.sheets import Layout, layout
from toros_fem.workshop.write import made_as, write_manufacture

__all__ = [
    "Layout",
    "SewingStep",
    "layout",
    "made_as",
    "read_regions",
    "sewing_order",
    "write_manufacture",
]
