"""Files of an earlier run, which are moved aside before a new one begins."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from toros_fem.results.runs.lock import NAME

# Folders that files are moved to, inside the folder of the run.
PREFIX = "earlier-"
# What tells a folder of results that has no record, and how names of such results end.
SIGNS = ("summary.json", "history.csv")
ENDINGS = (".csv", ".gif", ".html", ".json", ".npz", ".png", ".svg", ".vtu")
FOLDERS = ("frames", "manufacture")


def names_beside(folder: Path) -> tuple[str, ...]:
    """Return the names in a folder that belong to no run that is open or moved aside."""
    return tuple(sorted(p.name for p in folder.iterdir() if not _own(p.name)))


def move_aside(folder: Path, kept: Sequence[str] | None, *, last: str) -> Path | None:
    """Move the files of an earlier run into a new folder beside them; return it (one rank).

    Args:
        folder: Folder of the run.
        kept: Names that belong to no run. None, where no record says so: in a folder of results
            what has another ending than results have.
        last: Name that is moved after all others.

    Returns:
        None if there is nothing to move.

    Raises:
        OSError: A file cannot be moved.
    """
    names = names_beside(folder)
    if kept is not None:
        names = tuple(name for name in names if name not in kept)
    elif any(name in SIGNS for name in names):
        known = (*FOLDERS, last)
        names = tuple(name for name in names if name.endswith(ENDINGS) or name in known)
    else:
        names = tuple(name for name in names if name == last)  # a run that hardly began
    if not names:
        return None
    number = 1
    while (folder / f"{PREFIX}{number}").exists():
        number += 1
    place = folder / f"{PREFIX}{number}"
    place.mkdir()
    for name in sorted(names, key=lambda name: (name == last, name)):
        (folder / name).rename(place / name)
    return place


def _own(name: str) -> bool:
    return name == NAME or name.startswith(PREFIX)
