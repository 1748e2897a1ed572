"""The manifest of machine files: what is made, where it lies, and what belongs together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np
import shapely

from toros_fem.base.versions import versions
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.marks import notch_arcs
from toros_fem.making.panels.panel_drawing import PanelDrawing
from toros_fem.making.panels.seam_lines import SewnSeam
from toros_fem.making.sheets.layout import CutSheet, Manufacture

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
