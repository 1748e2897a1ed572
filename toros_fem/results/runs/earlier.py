"""Files of an earlier run, which are moved aside before a new one begins."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from toros_fem.results.runs.files import FILES, SIGNS, STATE
from toros_fem.results.runs.lock import NAME

# Folders that files are moved to, inside the folder of the run.
PREFIX = "earlier-"
KNOWN = {name.partition("/")[0] for name in FILES}


def names_beside(folder: Path) -> tuple[str, ...]:
    """Return the names in a folder that belong to no run that is open or moved aside."""
    names = (path.name for path in folder.iterdir())
    return tuple(sorted(n for n in names if n != NAME and not n.startswith(PREFIX)))


def move_aside(folder: Path, kept: Sequence[str] | None) -> Path | None:
    """Move the files of an earlier run into a new folder beside them; return it (one rank).

    Its state comes last: a run that is moved in part can be moved again.

    Args:
        folder: Folder of the run.
        kept: Names that belong to no run. None, where no record says so: all but the names that
            files of a run have, if there are some of a run that did more than begin.

    Returns:
        None if there is nothing to move.

    Raises:
        OSError: A file cannot be moved.
    """
    names = set(names_beside(folder))
    if kept is not None:
        names -= set(kept)
    else:
        names &= KNOWN if names & set(SIGNS) else {STATE}
    if not names:
        return None
    number = 1
    while (folder / f"{PREFIX}{number}").exists():
        number += 1
    place = folder / f"{PREFIX}{number}"
    place.mkdir()
    for name in sorted(names, key=lambda name: (name == STATE, name)):
        (folder / name).rename(place / name)
    return place
