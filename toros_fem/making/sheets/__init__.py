"""Machine files of a design on beds and sheets, with manifest and page."""

from toros_fem.making.sheets.cut_files import write_cut_dxf, write_cut_svg
from toros_fem.making.sheets.placement import Placement, nest
from toros_fem.making.sheets.print_bodies import (
    PrintBody,
    print_bodies,
    print_body,
    write_3mf,
    write_stl,
)
from toros_fem.making.sheets.reading import read_regions
from toros_fem.making.sheets.sewing_order import SewingStep, sewing_order
from toros_fem.making.sheets.sheets import Layout, layout
from toros_fem.making.sheets.write import made_as, write_manufacture

__all__ = [
    "Layout",
    "Placement",
    "PrintBody",
    "SewingStep",
    "layout",
    "made_as",
    "nest",
    "print_bodies",
    "print_body",
    "read_regions",
    "sewing_order",
    "write_3mf",
    "write_cut_dxf",
    "write_cut_svg",
    "write_manufacture",
    "write_stl",
]
