"""Pictures of beds, sheets and seams for a page, as SVG."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from toros_fem.making.panels.panel_labels import Label
from toros_fem.making.panels.svg import Svg
from toros_fem.making.sheets.layout import Sheet

# Corners closer than this to a line between others are left out of pictures, in m.
SEEN = 0.02e-3
# Border around a picture in m.
BORDER = 2e-3
# Diameter of the discs with the numbers of seams, over the width of the picture.
DISC = 0.028
# Turn of the hue from one seam to the next, in degrees: neighbours differ, none comes twice.
HUE = 137.5


def sheet_picture(sheet: Sheet, about: str) -> str:
    """Return a bed or a sheet with all that its files hold, one class for each layer.

    `about` tells readers who do not see it what is shown.
    """
    svg = _canvas(sheet, sheet.box, about)
    svg.region(svg.group({"class": "sheet"}), shapely.box(0, 0, *sheet.size))
    fabric = svg.group({"class": "fabric"})
    for one in sheet.drawings:
        svg.region(fabric, one.cut.simplify(SEEN))
    for name, layers in sheet.layers.items():
        group = svg.group({"class": name})
        for layer in layers:
            svg.add(replace(layer, region=layer.region.simplify(SEEN)), group)
    return str(svg)


def seam_picture(sheet: Sheet, about: str) -> str:
    """Return panels whose seams are coloured and numbered, both edges of a seam alike."""
    box = shapely.total_bounds([one.cut for one in sheet.drawings])
    svg = _canvas(sheet, box, about)
    fabric, printed, lines, marks = (
        svg.group({"class": name}) for name in ("fabric", "print", "sewn", "numbers")
    )
    radius = DISC * max(box[2:] - box[:2]) / 2
    for one in sheet.drawings:
        svg.region(fabric, one.cut.simplify(SEEN))
        svg.region(printed, one.printed.simplify(SEEN))
        for seam in one.seams:
            colour = seam_colour(seam.number)
            svg.line(lines, seam.line, {"style": f"stroke:{colour}"})
            middle = shapely.LineString(seam.line).interpolate(0.5, normalized=True)
            at = np.array([middle.x, middle.y])
            svg.disc(marks, at, radius, colour)
            svg.text(marks, Label(str(seam.number), at, 0.0, 0.86 * radius))
        at = shapely.get_coordinates(one.outline.representative_point())[0]
        svg.text(marks, Label(one.name, at, 0.0, radius), {"class": "name"})
    return str(svg)


def seam_colour(number: int) -> str:
    """Return the colour of a seam by its number, as CSS has it."""
    return f"hsl({HUE * (number - 1) % 360:.0f} 75% 38%)"


def _canvas(sheet: Sheet, box: tuple[float, ...] | np.ndarray, about: str) -> Svg:
    left, low, right, high = box
    wider = left - BORDER, low - BORDER, right + BORDER, high + BORDER
    return Svg(wider, sheet.size[1], digits=2, about=about)
