"""All machine files of a design, with their manifest and a page that shows how to make it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ManufactureFileError
from toros_fem.base.files import replace_file, write_json
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.bladder import bladder_drawings, tab_seam
from toros_fem.making.panels.panel_drawing import panel_drawings
from toros_fem.making.panels.printed_face import printed_face
from toros_fem.making.panels.seam_lines import sewn_seams
from toros_fem.making.sheets.cut_files import cut_dxf, cut_svg
from toros_fem.making.sheets.manifest import FORMAT, NAME, MadeFile, manifest
from toros_fem.making.sheets.page import NAME as PAGE
from toros_fem.making.sheets.page import page
from toros_fem.making.sheets.print_bodies import print_bodies, stl_of, threemf_of
from toros_fem.making.sheets.sewing_order import sewing_order
from toros_fem.making.sheets.sheets import film_layout, layout
from toros_fem.meshes.pattern import Pattern

# Folder of the machine files in that of a run.
FOLDER = "manufacture"
# Drawings of what is cut, by the endings of their files.
CUTS = {"svg": cut_svg, "dxf": cut_dxf}


def write_manufacture(
    folder: Path | str,
    pattern: Pattern,
    regions: Sequence[BaseGeometry],
    options: ManufactureOptions | None = None,
    *,
    summary: Mapping[str, Any] | None = None,
    title: str = "",
    others: Sequence[str] = (),
) -> dict[str, Any]:
    """Write print files, cut files, bladder, manifest and page of a design (one rank).

    The files are print_1.stl and print_1.3mf for the first bed, cut_1.svg and cut_1.dxf for the
    first sheet, and so on; bladder.svg and bladder.dxf; manufacture.json and make_it.html.
    Files of an earlier call, which its manufacture.json lists, go; all others stay.

    Args:
        folder: The folder, made if missing.
        pattern: The whole pattern.
        regions: Print on each panel, polygons in m.
        options: Settings; None takes those of `made_as`.
        summary: The run's summary, for materials, pressure and metrics; None knows none.
        title: Name of the design on the page; by default that of the folder above.
        others: Names of files that the caller writes into the folder afterwards.

    Returns:
        The manifest, as in manufacture.json.

    Raises:
        ManufactureFileError: A file of somebody else has the name of one that would be written.
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
    made: list[tuple[MadeFile, bytes]] = []
    for bed, drawn in enumerate(places.beds, 1):
        bodies = print_bodies(drawn, options)
        if bodies:
            text = f"print of bed {bed}, in mm"
            for end, written in (("3mf", threemf_of), ("stl", stl_of)):
                file = MadeFile(f"print_{bed}.{end}", "print", text, bed=bed)
                made.append((file, written(bodies)))
    for sheet, drawn in enumerate(places.sheets, 1):
        text = f"cut of sheet {sheet}, in mm, in layers"
        for end, cut in CUTS.items():
            file = MadeFile(f"cut_{sheet}.{end}", "cut", text, sheet=sheet)
            made.append((file, cut(drawn, places.sheet)))
    sheets_of_film = bladder_drawings(pattern, options)
    film = film_layout(sheets_of_film, options) if sheets_of_film else None
    if film is not None:
        text = f"cut of the bladder's {len(sheets_of_film)} sheets of film, in mm, in layers"
        for end, cut in CUTS.items():
            file = MadeFile(f"bladder.{end}", "bladder", text)
            made.append((file, cut(film.sheets[0], film.sheet)))
    at_tab = tab_seam(pattern, options)
    order = sewing_order(pattern, seams, [] if at_tab is None else [at_tab])
    files = [file for file, _ in made]
    about = manifest(places, film, seams, order, options, files, summary, others)
    name = title or folder.resolve().parent.name
    contents = {file.name: content for file, content in made}
    contents[PAGE] = page(about, places, film, name).encode()
    _make_room(folder, [NAME, *contents, *others])
    # First, so that after a kill the files are known as those of this package.
    write_json(folder / NAME, about)
    for file_name, content in contents.items():
        replace_file(folder / file_name, content)
    return about


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


def _make_room(folder: Path, names: Sequence[str]) -> None:
    """Remove the files that the folder's manifest lists, if nobody else's bar the way of new ones.

    Raises:
        ManufactureFileError: Some do.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        last = json.loads((folder / NAME).read_text(encoding="utf-8"))
        if last["format"] != FORMAT:
            raise ValueError("another's")
        listed = [*(file["name"] for file in last["files"]), *last.get("others", ())]
        ours = {NAME, PAGE, *(Path(name).name for name in listed)}
    except (OSError, ValueError, KeyError, TypeError):
        ours = set()
    barred = [name for name in names if name not in ours and (folder / name).exists()]
    if barred:
        raise ManufactureFileError(
            f"{folder} has {', '.join(barred)}, which {NAME} there does not list as made by "
            "toros. Move such files, or choose another folder; nothing was changed."
        )
    for name in ours - {NAME}:
        (folder / name).unlink(missing_ok=True)
