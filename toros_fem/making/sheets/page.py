"""The page make_it.html: pictures of every sheet, and how to make the skin in five steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import shapely

from toros_fem.base.packages import required, template
from toros_fem.making.panels.panel_labels import Label
from toros_fem.making.panels.svg import Svg
from toros_fem.making.sheets.layout import CutSheet, Manufacture
from toros_fem.making.sheets.manifest import ONE_SHEET
from toros_fem.measures.figures import Figure

NAME = "make_it.html"
# Corners closer than this to a line between others are left out of pictures, in m.
SEEN = 0.02e-3
# Border around a picture in m.
BORDER = 2e-3
# Diameter of the discs with the numbers of seams, over the width of the picture.
DISC = 0.028
# Turn of the hue from one seam to the next, in degrees: neighbours differ, none comes twice.
HUE = 137.5


def page(
    made: Manufacture,
    manifest: Mapping[str, Any],
    title: str,
    summary: Mapping[str, Any] | None = None,
) -> str:
    """Return the page, with a title, as HTML that needs no other file."""
    safe = required("markupsafe").Markup

    def drawn(
        draw: Callable[[CutSheet, str], str], sheets: Sequence[CutSheet], what: str
    ) -> list[str]:
        return [safe(draw(sheet, f"{what} {k}")) for k, sheet in enumerate(sheets, 1)]

    shown: str = template("toros_fem.making.sheets", NAME).render(
        title=title,
        made=manifest,
        corners=[made.bed_on_sheet(k)[1] for k in range(len(made.beds))],
        beds_on_sheet=made.grid[0] * made.grid[1],
        pictures={
            "beds": drawn(sheet_picture, made.beds, "bed"),
            "sheets": drawn(sheet_picture, made.sheets, "sheet"),
            "seams": drawn(seam_picture, made.sheets, "seams on sheet"),
        },
        colour_of=seam_colour,
        height_unknown=manifest["print"]["height_from"] == ONE_SHEET,
        metrics=_metrics(summary),
    )
    return shown


def _metrics(summary: Mapping[str, Any] | None) -> str:
    """Return the figures of a run's print that decide whether it is reached, in words."""
    figures = [
        Figure(*(row.get(one.name) for one in fields(Figure)))
        for row in (summary or {}).get("figures", [])
        if row["value"] is not None
    ]
    return ", ".join(figure.words for figure in figures if figure.state)


def sheet_picture(sheet: CutSheet, about: str) -> str:
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


def seam_picture(sheet: CutSheet, about: str) -> str:
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


def _canvas(sheet: CutSheet, box: tuple[float, ...] | np.ndarray, about: str) -> Svg:
    left, low, right, high = box
    wider = left - BORDER, low - BORDER, right + BORDER, high + BORDER
    return Svg(wider, sheet.size[1], digits=2, about=about)
