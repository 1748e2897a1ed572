"""How a design is made: print height, seam allowance, marks, beds and sheets."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from toros_fem.base.keys import Angle, In, OneOf, Table, key
from toros_fem.materials.sheet import PRINT_SIDES

# Lengths of a print, of what is cut or drawn beside a panel, and of machines and rolls of cloth.
# What is larger is in the wrong unit.
Height = Annotated[float, In("m", at_least=1e-5, at_most=0.05)]
Offset = Annotated[float, In("m", at_least=0, at_most=0.05)]
Small = Annotated[float, In("m", above=0, at_most=1)]
Gap = Annotated[float, In("m", at_least=0, at_most=1)]
Spacing = Annotated[float, In("m", at_least=1e-3, at_most=1)]
Bed = Annotated[float, In("m", above=0, at_most=5)]
Roll = Annotated[float, In("m", above=0, at_most=100)]

SEAMS, ALL = "seams", "all"
OUTSIDE, INSIDE = "outside", "inside"
TEXT, OUTLINES = "text", "outlines"
R12, R2010 = "R12", "R2010"


class ManufactureOptions(Table):
    """Settings of the machine files."""

    layer_height: Height = key(
        0.4e-3, "height of the whole print above the fabric, not of a layer of the slicer"
    )
    print_density: Annotated[float, In("kg/m³", at_least=100, at_most=20e3)] = key(
        1.22e3, "density of the print"
    )
    print_side: Annotated[str, OneOf(PRINT_SIDES)] = key(
        OUTSIDE, "face of the fabric that is printed, and seen on the drawings"
    )
    fabric_offset: Offset | None = key(
        None, "height of the print's lower face above the bed, by the fabric"
    )
    seam_allowance: Small | None = key(
        5e-3, "fabric beyond the seam line; none cuts on the line, without notches"
    )
    allowance_at: Annotated[str, OneOf((SEAMS, ALL))] = key(
        SEAMS, "edges that get an allowance: those that are sewn, or all"
    )
    notch_distance: Spacing = key(30e-3, "largest distance of notches on a seam")
    cross_size: Small = key(4e-3, "size of a registration cross")
    grain: Angle | None = key(
        90.0, "direction of the grain on the flat panels, from x; none leaves it free"
    )
    bed_width: Bed = key(0.25, "width of the printer's bed")
    bed_depth: Bed = key(0.21, "depth of the printer's bed")
    sheet_width: Bed | None = key(
        None, "width of a sheet of fabric and of the cutter; none takes the bed's"
    )
    sheet_depth: Roll | None = key(None, "depth of a sheet, along the grain; none takes the bed's")
    sheet_margin: Gap = key(10e-3, "border of a sheet and of the bed that stays free")
    copies: Annotated[int, In(at_least=1, at_most=200)] = key(
        1, "number of skins to make, such as fingers"
    )
    panel_gap: Gap = key(5e-3, "least distance of two panels on a sheet")
    letters: Annotated[str, OneOf((TEXT, OUTLINES))] = key(
        TEXT, "texts of the cut files: as text, or as outlines, for software that drops text"
    )
    dxf_version: Annotated[str, OneOf((R12, R2010))] = key(
        R2010, "version of the DXF files; old software reads R12"
    )

    @property
    def drawn_grain(self) -> float | None:
        """Direction of the grain on the drawings in rad, which show the printed face up."""
        if self.grain is None:
            return None
        return float(np.radians(180.0 - self.grain if self.print_side == INSIDE else self.grain))


DEFAULT = ManufactureOptions()
