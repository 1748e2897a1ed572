"""All machine files of a design, with their manifest and a page that shows how to make it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import TorosError
from toros_fem.base.files import replace_file, write_json
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.bladder import bladder_drawings, tab_seam
from toros_fem.making.panels.panel_drawing import PanelDrawing, panel_drawings
from toros_fem.making.panels.printed_face import printed_face
from toros_fem.making.panels.seam_lines import sewn_seams
from toros_fem.making.sheets.cut_files import write_cut_dxf, write_cut_svg
from toros_fem.making.sheets.manifest import NAME, MadeFile, manifest
from toros_fem.making.sheets.page import NAME as PAGE
from toros_fem.making.sheets.page import page
from toros_fem.making.sheets.print_bodies import print_bodies, write_3mf, write_stl
from toros_fem.making.sheets.sewing_order import sewing_order
from toros_fem.making.sheets.sheets import film_layout, layout
from toros_fem.meshes.pattern import Pattern

# Folder of the machine files in that of a run.
FOLDER = "manufacture"


def write_manufacture(
    folder: Path | str,
    pattern: Pattern,
    regions: Sequence[BaseGeometry],
    options: ManufactureOptions | None = None,
    *,
    summary: Mapping[str, Any] | None = None,
    title: str = "",
) -> dict[str, Any]:
    """Write print files, cut files, bladder, manifest and page of a design (one rank).

    The files are print_1.stl and print_1.3mf for the first bed, cut_1.svg and cut_1.dxf for the
    first sheet, and so on; bladder.svg and bladder.dxf; manufacture.json and make_it.html. What an
    earlier call left in the folder under such names is removed.

    Args:
        folder: The folder, made if missing.
        pattern: The whole pattern.
        regions: Print on each panel, polygons in m.
        options: Settings; None takes those of `made_as`.
        summary: The run's summary, for materials, pressure and metrics; None knows none.
        title: Name of the design on the page; by default that of the folder above.

    Returns:
        The manifest, as in manufacture.json.

    Raises:
        SheetError: A panel fits on no sheet.
        PatternError: The skin is moulded, so that it has no flat panels.
        MissingPackageError: A package of the extra `manufacture` is not installed.
    """
    folder = Path(folder)
    options = options or made_as(summary)
    pattern, regions = printed_face(pattern, regions, options)
    drawings = panel_drawings(pattern, regions, options)
    places = layout(drawings, options)
    seams = sewn_seams(pattern)
    folder.mkdir(parents=True, exist_ok=True)
    for kind in ("print", "cut"):
        for old in folder.glob(f"{kind}_*[0-9].*"):
            old.unlink()
    files = []
    for bed, drawn in enumerate(places.beds, 1):
        bodies = print_bodies(drawn, options)
        if bodies:
            write_stl(folder / f"print_{bed}.stl", bodies)
            write_3mf(folder / f"print_{bed}.3mf", bodies)
            for end in ("3mf", "stl"):
                text = f"print of bed {bed}, in mm"
                files.append(MadeFile(f"print_{bed}.{end}", "print", text, bed=bed))
    for sheet, drawn in enumerate(places.sheets, 1):
        text = f"cut of sheet {sheet}, in mm, in layers"
        files += [
            MadeFile(name, "cut", text, sheet=sheet)
            for name in _cut(folder, f"cut_{sheet}", drawn, places.sheet)
        ]
    sheets_of_film = bladder_drawings(pattern, options)
    film = film_layout(sheets_of_film, options) if sheets_of_film else None
    if film is not None:
        text = f"cut of the bladder's {len(sheets_of_film)} sheets of film, in mm, in layers"
        names = _cut(folder, "bladder", film.sheets[0], film.sheet)
        files += [MadeFile(name, "bladder", text) for name in names]
    at_tab = tab_seam(pattern, options)
    order = sewing_order(pattern, seams, [] if at_tab is None else [at_tab])
    made = manifest(places, film, seams, order, options, files, summary)
    name = title or folder.resolve().parent.name
    replace_file(folder / PAGE, page(made, places, film, name).encode())
    write_json(folder / NAME, made)
    return made


def made_as(summary: Mapping[str, Any] | None) -> ManufactureOptions:
    """Return the settings that fit a run's summary: thickness and face of the print, grain.

    The grain is that of the wales, across the courses of a knit.

    Args:
        summary: The run's summary; None takes the defaults.
    """
    inputs = (summary or {}).get("inputs") or {}
    thickness = inputs.get("reinforcement_thickness") or inputs.get("thickness")
    known = {"layer_height": thickness, "print_side": inputs.get("print_side")}
    if inputs.get("knit_ratio") is not None:
        known["grain"] = 90.0 + inputs["grain_angle"]
    return ManufactureOptions(**{name: value for name, value in known.items() if value is not None})


def if_possible(write: Callable[[], Any]) -> None:
    """Write machine files, or print in one line why there are none (one rank)."""
    try:
        write()
    except TorosError as missing:
        print(f"no machine files: {missing}", file=sys.stderr)


def _cut(
    folder: Path, name: str, drawn: Sequence[PanelDrawing], size: tuple[float, float]
) -> list[str]:
    write_cut_svg(folder / f"{name}.svg", drawn, size)
    write_cut_dxf(folder / f"{name}.dxf", drawn, size)
    return [f"{name}.svg", f"{name}.dxf"]
