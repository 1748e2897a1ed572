"""Files of materials: read strictly, and written entry by entry."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import MISSING
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI
from pydantic import TypeAdapter

from toros_fem.base.errors import FileError
from toros_fem.base.files import naming, replace_file
from toros_fem.base.keys import given_of, nearest, typed
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.scene import Document, key_lines, read_text
from toros_fem.base.validation import checked_path, require_kind
from toros_fem.materials.library.material import LibraryMaterial

WHAT, SHIPPED = "a file of materials", Path(__file__).with_name("materials.toml")
HEAD = "# Materials of one's own. Scenes name this file by: materials, in their table [files].\n"
# Keys of a material in a file, where its name is that of the table.
KEYS = {name: one for name, one in LibraryMaterial.described().items() if name != "name"}


def read_library(*paths: str | Path, comm: MPI.Comm | None = None) -> Mapping[str, LibraryMaterial]:
    """Return the shipped materials by name, and those of files of one's own over them.

    The first rank of a communicator reads for all (collective); without, each rank reads.

    Raises:
        FileError: A file cannot be read, or a key or value is wrong; with file, line and key.
            It is raised on all ranks.
    """
    places = [SHIPPED, *(checked_path("path", path, FileError) for path in paths)]

    def read() -> dict[str, LibraryMaterial]:
        return {name: one for path in places for name, one in read_materials(path).items()}

    return read() if comm is None else on_first_rank(comm, read)


def read_materials(path: Path, text: str | None = None) -> dict[str, LibraryMaterial]:
    """Return the materials of one file by name, in its order; of a text that it may hold."""
    text = read_text(path, WHAT) if text is None else text
    document = Document(path, text)
    names = dict.fromkeys(document.content, KEYS)
    entry = given_of("material", LibraryMaterial.holds(), KEYS)
    content = document.values(
        TypeAdapter(typed("materials", WHAT, dict.fromkeys(names, entry))), names
    )
    return {name: _entry(document, name, values) for name, values in content.items()}


def named(
    library: Mapping[str, LibraryMaterial], name: str, kind: str | None = None
) -> LibraryMaterial:
    """Return a material of a library, of a kind where one is asked for, or a FileError.

    That tells the nearest name, or that the material is of another kind.
    """
    known = [one for one, entry in library.items() if kind in (None, entry.kind)]
    if name not in known:
        what = f"is no {kind or 'material'} of the library"
        if name in library:
            what = f"is a {library[name].kind}, and a {kind} is asked for"
        raise FileError(f"{name!r} {what}; {nearest(name, known)} `toros materials` lists all.")
    return library[name]


def write_material(path: str | Path, entry: LibraryMaterial) -> None:
    """Write a material into a file of materials, made if it is missing (one rank).

    An entry of the same name is replaced. Others stay, with their comments.

    Raises:
        FileError: The file is there and cannot be read, or holds the entry in a form that
            cannot be replaced.
        OutputError: The file cannot be written.
    """
    path = checked_path("path", path, FileError)
    require_kind("entry", entry, LibraryMaterial, "a LibraryMaterial")
    mode = path.stat().st_mode if path.exists() else None
    text = HEAD if mode is None else read_text(path, WHAT)
    wanted, changed = {**read_materials(path, text), entry.name: entry}, _replaced(text, entry)
    try:
        found = read_materials(path, changed)
    except FileError:
        found = {}
    if found != wanted:
        raise FileError(
            f"{path}: {entry.name} does not stand there as a table [{entry.name}] of its own, and "
            "cannot be replaced. Take it out by hand.",
            path,
        )
    with naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, changed.encode())
        if mode is not None:
            path.chmod(mode)


def material_text(entry: LibraryMaterial) -> str:
    """Return the table of a material, as a file holds it, without defaults."""
    lines = [
        f"{key} = {one.written(getattr(entry, key))}"
        for key, one in KEYS.items()
        if getattr(entry, key) != one.default
    ]
    return "\n".join([f"[{entry.name}]", *lines, ""])


def _entry(document: Document, name: str, values: dict[str, Any]) -> LibraryMaterial:
    lacking = [key for key, one in KEYS.items() if one.default is MISSING and key not in values]
    if lacking:
        document.fail((name,), f"it has no {', '.join(lacking)}.")
    return document.made(partial(LibraryMaterial, name=name), (name,), values)


def _replaced(text: str, entry: LibraryMaterial) -> str:
    """Return the text of a file with an entry in the place of that of the same name, or added."""
    lines, block, places = text.splitlines(keepends=True), material_text(entry), key_lines(text)
    begin = places.get((entry.name,))
    if begin is None:
        gap = "" if not text else "\n" if text.endswith("\n") else "\n\n"
        return f"{text}{gap}{block}"
    headers = [line for place, line in places.items() if len(place) == 1 and line > begin]
    end = min(headers, default=len(lines) + 1)
    # What stands right above the next table, comments and empty lines, belongs to that.
    while end - 2 >= begin and re.fullmatch(r"\s*(#.*)?\n?", lines[end - 2]):
        end -= 1
    return "".join([*lines[: begin - 1], block, *lines[end - 1 :]])
