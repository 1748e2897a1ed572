"""Panels to cut: allowance, seams, marks, labels, the printed face, the bladder."""

from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.bladder import bladder_drawings, tab_seam
from toros_fem.making.panels.panel_drawing import PanelDrawing, Seam, panel_drawings
from toros_fem.making.panels.panel_labels import Label
from toros_fem.making.panels.printed_face import printed_face
from toros_fem.making.panels.seam_lines import SewnSeam, sewn_seams
from toros_fem.making.panels.svg import write_svg

__all__ = [
    "Label",
    "ManufactureOptions",
    "PanelDrawing",
    "Seam",
    "SewnSeam",
    "bladder_drawings",
    "panel_drawings",
    "printed_face",
    "sewn_seams",
    "tab_seam",
    "write_svg",
]
