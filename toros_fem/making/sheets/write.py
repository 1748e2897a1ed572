"""All machine files of a design, with their manifest and a page that shows how to make it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from toros_fem.base.errors import FileError
from toros_fem.base.files import read_json, replacing, write_json
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.sheets.cut_files import cut_dxf, cut_svg
from toros_fem.making.sheets.layout import Manufacture, manufacture
from toros_fem.making.sheets.manifest import FORMAT, NAME, MadeFile, manifest, print_height
from toros_fem.making.sheets.page import NAME as PAGE
from toros_fem.making.sheets.page import page
from toros_fem.making.sheets.print_bodies import print_bodies, stl_of, threemf_of
from toros_fem.meshes.pattern import Pattern, Regions

# Folder of the machine files in that of a run.
FOLDER = "manufacture"
# The manifest of the call that is writing.
NEXT = "manufacture.next.json"
# Files of what is printed and of what is cut, by their endings.
PRINTS = {"3mf": threemf_of, "stl": stl_of}
CUTS = {"svg": cut_svg, "dxf": cut_dxf}


def write_manufacture(
    folder: Path | str,
    pattern: Pattern,
    regions: Regions,
    options: ManufactureOptions | None = None,
    *,
    summary: Mapping[str, Any] | None = None,
    title: str = "",
    others: Sequence[str] = (),
) -> dict[str, Any]:
    """Write print files, cut files, manifest and page of a whole pattern (one rank).

    The files are print_1.stl and print_1.3mf for the first bed, cut_1.svg and cut_1.dxf for the
    first sheet, and so on; manufacture.json and make_it.html.
    All are written beside before the first one takes its place, so that a full disk leaves those of
    an earlier call whole; these, which its manufacture.json lists, go at the end if they are as
    they were written. All others stay. Returned is the manifest.

    Args:
        options: Settings; None takes those of `made_as`.
        summary: The run's summary, for materials, pressure and metrics; None knows none.
        title: Name of the design on the page; by default that of the folder above.
        others: Names of files that the caller writes into the folder afterwards.

    Raises:
        FileError: A file of somebody else, or one that was changed, has the name of one
            that would be written.
        OutlineError, PatternError, MissingPackageError: As of `manufacture`, or a package of the
            extra `manufacture` is not installed.
    """
    folder = Path(folder)
    options = options or made_as(summary)
    made = manufacture(pattern, regions, options)
    files = list(machine_files(made))
    about = manifest(made, files, summary, others)
    shown = page(made, about, title or folder.resolve().parent.name, summary)
    contents = {**{file.name: file.content for file in files}, PAGE: shown.encode()}
    folder.mkdir(parents=True, exist_ok=True)
    earlier = _earlier(folder)
    _require_room(folder, [NAME, NEXT, *contents, *others], earlier)
    # With it the files are known as those of this package, also after a kill between two of them.
    write_json(folder / NEXT, about)
    with ExitStack() as swapped:
        try:
            for name, content in contents.items():
                beside = swapped.enter_context(replacing(folder / name))
                with beside.open("wb") as file:
                    file.write(content)
                    os.fsync(file.fileno())  # what does not fit on the disk is told here
        except BaseException:
            (folder / NEXT).unlink()
            raise
    write_json(folder / NAME, about)
    there = {path.name for path in folder.iterdir()}
    for name in sorted(there & (earlier.keys() - {NAME, NEXT, *contents, *others})):
        if _is_ours(folder / name, earlier):
            (folder / name).unlink()
    (folder / NEXT).unlink()
    return about


def made_before(folder: Path) -> list[Path]:
    """Return the files that earlier calls wrote into a folder, and that are there (one rank).

    Raises:
        FileError: One of them was changed since.
    """
    earlier = _earlier(folder)
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    names = sorted(name for name in earlier.keys() & there if (folder / name).is_file())
    if names:
        _require_room(folder, names, earlier)
    return [folder / name for name in names]


def machine_files(made: Manufacture) -> Iterator[MadeFile]:
    """Yield each file for printer and cutter."""
    for bed, sheet in enumerate(made.beds, 1):
        bodies = print_bodies(sheet.drawings, made.options)
        for end, written in PRINTS.items() if bodies else ():
            shows = f"print of bed {bed}, in mm"
            yield MadeFile(f"print_{bed}.{end}", "print", shows, written(bodies), bed=bed)
    for number, sheet in enumerate(made.sheets, 1):
        for end, cut in CUTS.items():
            shows = f"cut of sheet {number}, in mm, in layers"
            yield MadeFile(
                f"cut_{number}.{end}", "cut", shows, cut(sheet, made.options), sheet=number
            )


def made_as(summary: Mapping[str, Any] | None) -> ManufactureOptions:
    """Return the settings that fit a run's summary: height and face of the print, grain.

    The height is that of `print_height`. The grain is that of the wales, across the courses of a
    knit. Without a summary they are the defaults.
    """
    inputs = (summary or {}).get("inputs") or {}
    known: dict[str, Any] = {"layer_height": print_height(inputs)[0]}
    known["print_side"] = inputs.get("print_side")
    if inputs.get("knit_ratio") is not None:
        known["grain"] = 90.0 + inputs["grain_angle"]
    return ManufactureOptions(**{name: value for name, value in known.items() if value is not None})


def _earlier(folder: Path) -> dict[str, set[str] | None]:
    """Return the files of earlier calls, by name with their digests; None where none is known."""
    found: dict[str, set[str] | None] = {}
    for name in (NAME, NEXT):
        with suppress(Exception):  # anybody's file may have this name
            last = read_json(folder / name)
            if last["format"] == FORMAT:
                found |= dict.fromkeys([NAME, NEXT, PAGE, *last.get("others", ())])
                for file in last["files"]:
                    digests = found.setdefault(Path(file["name"]).name, set())
                    if digests is not None:
                        digests.add(file.get("sha256"))
    return found


def _is_ours(path: Path, earlier: Mapping[str, set[str] | None]) -> bool:
    """Return whether a file is as an earlier call wrote it, or of one without a digest."""
    digests = earlier.get(path.name, set())
    return digests is None or sha256(path.read_bytes()).hexdigest() in digests


def _require_room(
    folder: Path, names: Sequence[str], earlier: Mapping[str, set[str] | None]
) -> None:
    """Raise where somebody else's files have the names of new ones."""
    there = {path.name for path in folder.iterdir()}
    barred = [name for name in names if name in there and not _is_ours(folder / name, earlier)]
    if barred:
        raise FileError(
            f"{folder} has {', '.join(barred)}, which {NAME} there does not list as made by "
            "toros, or which changed since. Move such files, or choose another folder; nothing "
            "was done to them."
        )
