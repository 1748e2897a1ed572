"""The manifest of machine files: what is made, where it lies, and what belongs together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.versions import versions
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.marks import notch_arcs
from toros_fem.making.panels.panel_drawing import PanelDrawing
from toros_fem.making.panels.seam_lines import SewnSeam
from toros_fem.making.sheets.sewing_order import SewingStep
from toros_fem.making.sheets.sheets import Layout

NAME = "manufacture.json"
FORMAT, VERSION = "toros_fem manufacture", 1
# Inputs of a run that say what it is made of.
MATERIALS = (
    "fabric_young", "reinforcement_young", "poisson", "reinforcement_poisson", "thickness",
    "reinforcement_thickness", "c1", "reinforcement_c1", "c2", "reinforcement_c2", "bladder_young",
    "bladder_thickness", "knit_ratio", "grain_angle",
)  # fmt: skip


@dataclass(frozen=True)
class MadeFile:
    """A file that was written.

    Attributes:
        name: Its name in the folder.
        kind: "print", "cut" or "bladder".
        shows: What it holds, in some words.
        bed: Number of the bed, from 1; None where there is none.
        sheet: Number of the sheet, from 1; None where there is none.
    """

    name: str
    kind: str
    shows: str
    bed: int | None = None
    sheet: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return what is known of it."""
        return {name: value for name, value in vars(self).items() if value is not None}


def manifest(
    layout: Layout,
    film: Layout | None,
    seams: Sequence[SewnSeam],
    order: Sequence[SewingStep],
    options: ManufactureOptions,
    files: Sequence[MadeFile],
    summary: Mapping[str, Any] | None = None,
    others: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the manifest as plain values; each key of a number ends in its unit.

    Args:
        layout: Panels and their places.
        film: Sheets of the bladder and their places; None without one.
        seams: All seams.
        order: The order in which they are sewn.
        options: Settings of the machine files.
        files: The files.
        summary: The run's summary, for materials, pressure and metrics; None knows none.
        others: Names of files beside these.
    """
    names = [one.name for one in layout.drawings]
    run = dict(summary or {})
    inputs = run.get("inputs") or {}
    figures = {f"{row['name']}_{row['unit']}": row for row in run.get("figures", [])}
    found = {key: row["value"] for key, row in figures.items() if row["target"] is not None}
    printed = float(sum(one.printed.area for one in layout.drawings))
    return {
        "format": FORMAT,
        "version": VERSION,
        "files": [file.as_dict() for file in files],
        "others": list(others),
        "beds": [_sheet(bed, layout.bed, options) for bed in layout.beds],
        "sheets": [_sheet(sheet, layout.sheet, options) for sheet in layout.sheets],
        "panels": [_panel(one, options) for one in layout.drawings],
        "placements": [
            {
                "panel": place.panel,
                "bed": place.sheet + 1,
                "angle_deg": float(np.degrees(place.angle)),
                "offset_on_bed_mm": _mm(place.offset),
                "sheet": on_sheet.sheet + 1,
                "offset_on_sheet_mm": _mm(on_sheet.offset),
            }
            for place, on_sheet in zip(layout.placements, layout.on_sheets, strict=True)
        ],
        "seams": [
            {
                "number": seam.number,
                "panels": [names[panel] for panel in seam.panels],
                "length_mm": 1e3 * seam.length,
                "length_of_each_edge_mm": [
                    1e3 * float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
                    for line in seam.lines
                ],
                "notches_mm": _mm(_notches(seam, options)),
            }
            for seam in seams
        ],
        "sewing": [
            {"seam": step.seam, "kind": step.kind, "opening_mm": 1e3 * step.opening}
            for step in order
        ],
        "bladder": _film(film),
        "print": _print(printed, options),
        "options": options.as_dict(),
        "materials": {name: inputs[name] for name in MATERIALS if name in inputs},
        "pressure_pa": figures["pressure_pa"]["value"] if "pressure_pa" in figures else None,
        "metrics": found,
        "versions": versions(),
    }


def _sheet(
    drawings: Sequence[PanelDrawing], size: tuple[float, float], options: ManufactureOptions
) -> dict[str, Any]:
    return {
        "size_mm": _mm(size),
        "panels": [one.name for one in drawings],
        "fabric_used": float(sum(one.cut.area for one in drawings) / np.prod(size)),
        **_print(float(sum(one.printed.area for one in drawings)), options),
    }


def _panel(one: PanelDrawing, options: ManufactureOptions) -> dict[str, Any]:
    low, high = np.reshape(one.cut.bounds, (2, 2))
    return {
        "name": one.name,
        "cut_size_mm": _mm(high - low),
        "area_mm2": 1e6 * float(one.outline.area),
        "cut_area_mm2": 1e6 * float(one.cut.area),
        "seams": sorted({seam.number for seam in one.seams}),
        "notches": len(one.notches),
        **_print(float(one.printed.area), options),
    }


def _film(film: Layout | None) -> dict[str, Any] | None:
    if film is None:
        return None
    return {
        "film_mm": _mm(film.sheet),
        "sheets": [
            {
                "name": one.name,
                "cut_size_mm": _mm(np.ptp(np.reshape(one.cut.bounds, (2, 2)), axis=0)),
            }
            for one in film.drawings
        ],
    }


def _print(area: float, options: ManufactureOptions) -> dict[str, float]:
    """Return area, volume and mass of a print of an area in m²."""
    volume = area * options.layer_height
    return {
        "print_area_mm2": 1e6 * area,
        "print_volume_mm3": 1e9 * volume,
        "print_mass_g": 1e3 * volume * options.print_density,
    }


def _notches(seam: SewnSeam, options: ManufactureOptions) -> Floats:
    """Return the places of notches along a seam in m; none where the cut is the seam line."""
    if options.seam_allowance is None:
        return np.empty(0)
    return notch_arcs(seam.length, options.notch_distance)


def _mm(lengths: Any) -> list[float]:
    return [1e3 * float(length) for length in lengths]
