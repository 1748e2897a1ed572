"""What is told beside the sheets: manufacture.json, and the page make_it.html."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from hashlib import sha256
from typing import Any

import numpy as np
import shapely

from toros_fem.base.packages import required, template, versions
from toros_fem.making.layout import CutSheet, Manufacture
from toros_fem.making.marks import Label, SewnSeam, notch_arcs
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panel_drawing import PanelDrawing, Svg
from toros_fem.measures.figures import Figure

NAME = "manufacture.json"
FORMAT, VERSION = "toros_fem manufacture", 1
# Where the height of a print is from: a material that is the printed layer alone; the thickness
# of print and fabric as one sheet, since nothing else is known; the settings of the files.
MATERIAL, ONE_SHEET, OPTIONS = "material", "one sheet", "options"
# Inputs of a run that say what it is made of.
MATERIALS = (
    "fabric_young", "reinforcement_young", "poisson", "reinforcement_poisson", "thickness",
    "reinforcement_thickness", "print_height", "c1", "reinforcement_c1", "c2", "reinforcement_c2",
    "bladder_young", "bladder_thickness", "knit_ratio", "grain_angle",
)  # fmt: skip
PAGE = "make_it.html"
# Corners closer than this to a line between others are left out of pictures, in m.
SEEN = 0.02e-3
# Border around a picture in m.
BORDER = 2e-3
# Diameter of the discs with the numbers of seams, over the width of the picture.
DISC = 0.028
# Turn of the hue from one seam to the next, in degrees: neighbours differ, none comes twice.
HUE = 137.5


@dataclass(frozen=True)
class MadeFile:
    """A file for printer and cutter: what it shows, in some words, and its bytes.

    Its kind is "print" or "cut"; beds and sheets are numbered from 1.
    """

    name: str
    kind: str
    shows: str
    content: bytes
    bed: int | None = None
    sheet: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return what is known of it, with a digest of its content."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        known["sha256"] = sha256(known.pop("content")).hexdigest()
        return known


def manifest(
    made: Manufacture,
    files: Sequence[MadeFile],
    summary: Mapping[str, Any] | None = None,
    others: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the manifest as plain values; each key of a number ends in its unit.

    The summary is the run's, for materials, pressure and metrics; others are names of files beside
    those that are made.
    """
    options = made.options
    run = dict(summary or {})
    inputs = run.get("inputs") or {}
    height, source = print_height(inputs)
    figures = {f"{row['name']}_{row['unit']}": row for row in run.get("figures", [])}
    return {
        "format": FORMAT,
        "version": VERSION,
        "files": [file.as_dict() for file in files],
        "others": list(others),
        "beds": [_sheet(bed, options) for bed in made.beds],
        "sheets": [_sheet(sheet, options) for sheet in made.sheets],
        "panels": [_panel(one, options) for one in made.drawings],
        "placements": [
            {
                "panel": on_bed.panel,
                "bed": on_bed.sheet + 1,
                "angle_deg": float(np.degrees(on_bed.angle)),
                "offset_on_bed_mm": _mm(on_bed.offset),
                "sheet": on_sheet.sheet + 1,
                "offset_on_sheet_mm": _mm(on_sheet.offset),
            }
            for on_bed, on_sheet in zip(made.placements, made.on_sheets, strict=True)
        ],
        "seams": [_seam(seam, made) for seam in made.seams],
        "print": {
            "height_mm": 1e3 * options.layer_height,
            "height_from": source if options.layer_height == height else OPTIONS,
            **_print(made.drawings, options),
        },
        "options": options.as_dict(),
        "materials": {name: inputs[name] for name in MATERIALS if name in inputs},
        "pressure_pa": figures["pressure_pa"]["value"] if "pressure_pa" in figures else None,
        "metrics": {
            key: row["value"] for key, row in figures.items() if row["tolerance"] is not None
        },
        "versions": versions(),
    }


def print_height(inputs: Mapping[str, Any]) -> tuple[float | None, str]:
    """Return the height in m that a run's print is made in by its inputs, and where it is from.

    A material that is the printed layer alone has a height, `MATERIAL`. Of another one only the
    thickness of print and fabric as `ONE_SHEET` is known. Where the run says nothing, the height is
    None, from the `OPTIONS`.
    """
    if inputs.get("print_height") is not None:
        return inputs["print_height"], MATERIAL
    thickness = inputs.get("reinforcement_thickness") or inputs.get("thickness")
    return thickness, OPTIONS if thickness is None else ONE_SHEET


def _sheet(sheet: CutSheet, options: ManufactureOptions) -> dict[str, Any]:
    return {
        "size_mm": _mm(sheet.size),
        "panels": [one.name for one in sheet.drawings],
        "fabric_used": float(sum(one.cut.area for one in sheet.drawings) / np.prod(sheet.size)),
        **_print(sheet.drawings, options),
    }


def _panel(one: PanelDrawing, options: ManufactureOptions) -> dict[str, Any]:
    return {
        "name": one.name,
        "cut_size_mm": _mm(np.ptp(np.reshape(one.cut.bounds, (2, 2)), axis=0)),
        "area_mm2": 1e6 * float(one.outline.area),
        "cut_area_mm2": 1e6 * float(one.cut.area),
        "seams": sorted({seam.number for seam in one.seams}),
        "notches": len(one.notches),
        **_print([one], options),
    }


def _seam(seam: SewnSeam, made: Manufacture) -> dict[str, Any]:
    names, options = [one.name for one in made.drawings], made.options
    # Where the cut is the seam line there are no notches.
    cut_on_line = options.seam_allowance is None
    notches = () if cut_on_line else notch_arcs(seam.length, options.notch_distance)
    return {
        "number": seam.number,
        "panels": [names[panel] for panel in seam.panels],
        "length_mm": 1e3 * seam.length,
        "length_of_each_edge_mm": [1e3 * shapely.LineString(line).length for line in seam.lines],
        "notches_mm": _mm(notches),
    }


def _print(drawings: Sequence[PanelDrawing], options: ManufactureOptions) -> dict[str, float]:
    """Return area, volume and mass of the print of some panels."""
    area = float(sum(one.printed.area for one in drawings))
    volume = area * options.layer_height
    return {
        "print_area_mm2": 1e6 * area,
        "print_volume_mm3": 1e9 * volume,
        "print_mass_g": 1e3 * volume * options.print_density,
    }


def _mm(lengths: Iterable[float]) -> list[float]:
    return [1e3 * float(length) for length in lengths]


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

    shown: str = template("toros_fem.making", PAGE).render(
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
