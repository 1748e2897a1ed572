"""How a design is made: print height, seam allowance, marks, beds and sheets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.config import Config, quantity
from toros_fem.base.validation import require_kind
from toros_fem.materials.sheet import PRINT_SIDES

SEAMS, ALL = "seams", "all"
OUTSIDE, INSIDE = "outside", "inside"


@dataclass(frozen=True)
class ManufactureOptions(Config):
    """Settings of the machine files.

    Raises:
        ParameterError: A value is out of its bounds.
    """

    layer_height: float = quantity(0.4e-3, "height of the print above the fabric", "m", above=0)
    print_density: float = quantity(1.22e3, "density of the print", "kg/m³", above=0)
    print_side: str = quantity(
        OUTSIDE, "face of the fabric that is printed, and seen on the drawings", choices=PRINT_SIDES
    )
    fabric_offset: float | None = quantity(
        None,
        "height of the print's lower face above the bed, by the fabric",
        "m",
        at_least=0,
    )
    seam_allowance: float | None = quantity(
        5e-3, "fabric beyond the seam line; none cuts on the line, without notches", "m", above=0
    )
    allowance_at: str = quantity(
        SEAMS, "edges that get an allowance: those that are sewn, or all", choices=(SEAMS, ALL)
    )
    notch_distance: float = quantity(30e-3, "largest distance of notches on a seam", "m", above=0)
    cross_size: float = quantity(4e-3, "size of a registration cross", "m", above=0)
    grain: float | None = quantity(
        90.0, "direction of the grain on the flat panels, from x; none leaves it free", "deg"
    )
    bed_width: float = quantity(0.25, "width of the printer's bed", "m", above=0)
    bed_depth: float = quantity(0.21, "depth of the printer's bed", "m", above=0)
    sheet_width: float | None = quantity(
        None, "width of a sheet of fabric and of the cutter; none takes the bed's", "m", above=0
    )
    sheet_depth: float | None = quantity(
        None, "depth of a sheet, along the grain; none takes the bed's", "m", above=0
    )
    sheet_margin: float = quantity(
        10e-3, "border of a sheet and of the bed that stays free", "m", at_least=0
    )
    copies: int = quantity(1, "number of skins to make, such as fingers", at_least=1)
    panel_gap: float = quantity(5e-3, "least distance of two panels on a sheet", "m", at_least=0)
    weld_allowance: float = quantity(
        6e-3, "film of the bladder beyond the panels, for its weld", "m", above=0
    )
    connector_width: float | None = quantity(
        8e-3, "width of the bladder's tab for its tube; none leaves it out", "m", above=0
    )
    connector_length: float = quantity(20e-3, "length of the tab beyond the weld", "m", above=0)

    @property
    def drawn_grain(self) -> float | None:
        """Direction of the grain on the drawings in rad, which show the printed face up."""
        if self.grain is None:
            return None
        return float(np.radians(180.0 - self.grain if self.print_side == INSIDE else self.grain))


def options_or_default(options: ManufactureOptions | None) -> ManufactureOptions:
    """Return settings, or the defaults for None.

    Raises:
        ParameterError: They are something else.
    """
    if options is None:
        return ManufactureOptions()
    require_kind("options", options, ManufactureOptions, "ManufactureOptions(…), or None")
    return options
