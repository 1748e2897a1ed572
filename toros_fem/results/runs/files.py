"""The files of a run, by the one table that says what each holds: no other name is ever removed."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

from toros_fem.base.errors import OutputError

# Folder of the state inside that of a run, its record, the text of the scene, and the figures;
# folder of the machine files.
MADE = "manufacture"
STATE, RECORD, SCENE, SUMMARY = "state", "run.json", "scene.toml", "summary.json"

_TABLE = resources.files("toros_fem.results").joinpath("files.csv").read_text(encoding="utf-8")
# What each file holds, in the order of lists; of a folder what is in it, or the file to open.
FILES: Mapping[str, str] = {
    row["file"]: row["what it holds"] for row in csv.DictReader(_TABLE.splitlines())
}
# Names of the files in the folders of a run, but for those that a manifest lists.
_INSIDE = {
    "frames": re.compile(r"(skin-[0-9a-f]{12}|[a-z]+(-\d+)?-\d{6})\.npz"),
    STATE: re.compile(r"run\.json|([\w-]+\.)*\d{3}\.npz"),
}


def files_of_run(folder: Path) -> list[Path]:
    """Return the files of a run that are in its folder, its record the last (one rank).

    They are those that the table names, and in the folders of a run those of its names; machine
    files as they were made. A link counts as a file, and is never followed.

    Raises:
        OutputError: A folder of a run is a link.
        FileError: A machine file was changed since it was made.
    """
    from toros_fem.making.sheets.write import made_before  # who only reads names pays nothing

    require_no_link(folder)
    found = [folder / name for name in FILES if "/" not in name]
    for name, pattern in _INSIDE.items():
        inside = folder / name
        names = sorted(os.listdir(inside)) if inside.is_dir() else []
        found += [inside / one for one in names if pattern.fullmatch(one)]
    found += made_before(folder / MADE)
    record = folder / STATE / RECORD
    there = [path for path in found if _is_file(path) and path != record]
    return [*there, record] if _is_file(record) else there


def require_no_link(folder: Path) -> None:
    """Check that no folder of a run is a link, through which files would be written elsewhere."""
    for name in (*_INSIDE, MADE):
        if (folder / name).is_symlink():
            raise OutputError(
                f"{folder / name} is a link, through which files would be written elsewhere. "
                "Remove the link, or choose another folder; nothing was done to it."
            )


def _is_file(path: Path) -> bool:
    return path.is_symlink() or path.is_file()
