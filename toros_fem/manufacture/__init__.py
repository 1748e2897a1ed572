"""Machine files of a finished design: print bodies, cut files, bladder."""

from toros_fem.manufacture.options import ManufactureOptions
from toros_fem.manufacture.panel_drawing import PanelDrawing, Seam, panel_drawings
from toros_fem.manufacture.panel_labels import Label
from toros_fem.manufacture.placement import Placement, nest
from toros_fem.manufacture.seam_lines import SewnSeam, sewn_seams

__all__ = [
    "Label",
    "ManufactureOptions",
    "PanelDrawing",
    "Placement",
    "Seam",
    "SewnSeam",
    "nest",
    "panel_drawings",
    "sewn_seams",
]
