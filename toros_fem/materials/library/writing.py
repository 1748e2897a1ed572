"""Files of materials, written: one entry is added or replaced, all else stays as it is."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path

from toros_fem.base.errors import LibraryError, OutputError
from toros_fem.base.toml_files.document import read_text
from toros_fem.base.toml_files.lines import key_lines
from toros_fem.base.validation import checked_path, require_kind
from toros_fem.materials.library.material import LibraryMaterial, MaterialValues
from toros_fem.materials.library.reading import KEYS, NEEDED, RANGE, materials_of

HEAD = "# Materials of one's own. Scenes name this file by: materials, in their table [files].\n"


def write_material(path: str | Path, entry: LibraryMaterial) -> None:
    """Write a material into a file of materials (one rank).

    An entry of the same name is replaced. Others stay, with their comments. The file is made if it
    is missing.

    Args:
        path: The file.
        entry: The material.

    Raises:
        LibraryError: The file is there and cannot be read, or holds the entry in a form that
            cannot be replaced.
        OutputError: The file cannot be written.
    """
    path = checked_path("path", path, LibraryError)
    require_kind("entry", entry, LibraryMaterial, "a LibraryMaterial")
    text = read_text(path, "a file of materials", LibraryError) if path.exists() else HEAD
    before = materials_of(path, text)
    changed = _replaced(text, entry)
    if _read(path, changed) != {**before, entry.name: entry}:
        raise LibraryError(
            f"{path}: {entry.name} does not stand there as a table [{entry.name}] of its own, and "
            "cannot be replaced. Take it out by hand.",
            path,
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(changed)
        os.chmod(name, path.stat().st_mode if path.exists() else 0o644)
        os.replace(name, path)
    except OSError as caught:
        raise OutputError(
            f"{path} could not be written: {caught}. Choose another file, or free some space."
        ) from None


def material_text(entry: LibraryMaterial) -> str:
    """Return the table of a material, as a file of materials holds it."""
    lines = [f"[{entry.name}]"]
    for key in KEYS:
        value = getattr(entry, key)
        if key == RANGE:
            lines.append(f"{key} = [{value[0]!r}, {value[1]!r}]")
        elif key in NEEDED or value not in (None, False):
            lines.append(f"{key} = {MaterialValues.described()[key].written(value)}")
    return "\n".join(lines) + "\n"


def _replaced(text: str, entry: LibraryMaterial) -> str:
    """Return the text of a file with an entry in the place of that of the same name, or added."""
    lines, block = text.splitlines(keepends=True), material_text(entry)
    places = key_lines(text)
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


def _read(path: Path, text: str) -> dict[str, LibraryMaterial] | None:
    try:
        return materials_of(path, text)
    except LibraryError:
        return None
