"""Files of an earlier run, which are moved aside before a new one begins."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from toros_fem.base.errors import OutputError
from toros_fem.base.files import LISTED, add_to_list, listed
from toros_fem.results.runs.files import FILES, RECORD, STATE

# Folders that files are moved to, inside the folder of the run.
PREFIX = "earlier-"


def move_aside(folder: Path) -> Path | None:
    """Move the files of an earlier run into a new folder beside them; return it (one rank).

    These are the files that it listed; all others stay. Its state comes last: a run that is moved
    in part can be moved again. The folder is locked. None if there is nothing to move.

    Raises:
        OutputError: A file that no run listed has the name of a file of runs; nothing is moved.
        OSError: A file cannot be moved.
    """
    state = folder / STATE
    known = listed(folder)
    ours = STATE in known or (state / RECORD).is_file()
    require_room(folder, [*known, *[STATE] * ours])
    there = [name for name in known if name != STATE and os.path.lexists(folder / name)]
    own = [STATE] if ours and os.path.lexists(state) else []
    if not there and not own:
        return None
    number = 1
    while os.path.lexists(folder / f"{PREFIX}{number}"):
        number += 1
    place = folder / f"{PREFIX}{number}"
    place.mkdir()
    add_to_list(place, [*there, *own])
    _move(folder, place, [*there, *own])
    return place


def move_back(place: Path) -> None:
    """Move an earlier run back from its new folder; what was not there before must be gone."""
    _move(place, place.parent, reversed(listed(place)))
    (place / LISTED).unlink()
    with suppress(OSError):  # what is not empty stays
        place.rmdir()


def require_room(folder: Path, known: Iterable[str]) -> None:
    """Check that no other than known files have names of files of runs (one rank)."""
    own = {name.partition("/")[0] for name in known}
    taken = []
    for name, slash, _ in (name.partition("/") for name in FILES):
        path, is_folder = folder / name, bool(slash) and name != STATE
        mine = is_folder and path.is_dir() and not path.is_symlink()
        if os.path.lexists(path) and name not in own and not mine:
            taken.append(name)
    if taken:
        raise OutputError(
            f"{folder} has {', '.join(taken)}, which no run listed in {LISTED} there. Choose "
            "another folder, or move such files; nothing was done to them."
        )


def _move(folder: Path, place: Path, names: Iterable[str]) -> None:
    """Move files into another folder, and remove folders that are empty then."""
    for name in names:
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        (folder / name).rename(path)
        for inside in (folder / name).parents:
            if inside == folder:
                break
            with suppress(OSError):  # what is not empty stays
                inside.rmdir()
