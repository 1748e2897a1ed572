"""Machine files of a finished design: print bodies, cut files, bladder."""

from toros_fem.manufacture.bladder import bladder_drawings, tab_seam
from toros_fem.manufacture.cut_files import write_cut_dxf, write_cut_svg
from toros_fem.manufacture.options import ManufactureOptions
from toros_fem.manufacture.panel_drawing import PanelDrawing, Seam, panel_drawings
from toros_fem.manufacture.panel_labels import Label
from toros_fem.manufacture.placement import Placement, nest
from toros_fem.manufacture.print_bodies import (
    PrintBody,
    print_bodies,
    print_body,
    write_3mf,
    write_stl,
)
from toros_fem.manufacture.printed_face import printed_face
from toros_fem.manufacture.seam_lines import SewnSeam, sewn_seams

__all__ = [
    "Label",
    "ManufactureOptions",
    "PanelDrawing",
    "Placement",
    "PrintBody",
    "Seam",
    "SewnSeam",
    "bladder_drawings",
    "nest",
    "panel_drawings",
    "print_bodies",
    "print_body",
    "printed_face",
    "sewn_seams",
    "tab_seam",
    "write_3mf",
    "write_cut_dxf",
    "write_cut_svg",
    "write_stl",
]
