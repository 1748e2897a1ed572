"""A sewing pattern as a file: panels, seams, and the assembled shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools
from toros_fem.base.errors import PatternFileError, TorosError
from toros_fem.base.files import UNREADABLE, reason
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import checked_path, require_kind, shown
from toros_fem.meshes.pattern import Pattern

NAME = "pattern.npz"
FORMAT = "toros_fem pattern"
VERSION = 1
ARRAYS = ("flat_points", "flat_triangles", "panel", "sewn", "points", "panel_names")
NUMBERS = ("seam_tolerance", "moulded")
PRINTED = "printed"

T = TypeVar("T")


def write_pattern(path: Path | str, pattern: Pattern, printed: Bools | None = None) -> None:
    """Write a pattern as a compressed NumPy archive (one rank).

    Its entries are the fields of `Pattern` by name, lengths in m, with "format" and "version", and
    "printed" where it is given.

    Args:
        path: File ending in .npz.
        pattern: The pattern.
        printed: Whether each triangle is printed, (t,); None leaves it out.

    Raises:
        PatternFileError: The path does not end in .npz.
    """
    path = checked_path("path", path, PatternFileError)
    if path.suffix != ".npz":  # NumPy would write another file, with that ending added
        raise PatternFileError(f"path = {shown(str(path))} must end in .npz.")
    require_kind("pattern", pattern, Pattern, "a Pattern")
    entries = pattern_entries(pattern)
    if printed is not None:
        entries[PRINTED] = printed
    np.savez_compressed(path, format=FORMAT, version=VERSION, **entries)


@collective("comm")
def read_pattern(comm: MPI.Comm, path: Path | str) -> Pattern:
    """Read the pattern that `write_pattern` wrote, the same on all ranks (collective).

    Args:
        comm: Communicator; the first rank reads.
        path: The file.

    Raises:
        PatternFileError: There is no such file, it is another kind of file, of a newer version,
            lacks an entry, or holds no valid pattern.
    """
    place = checked_path("path", path, PatternFileError)
    wanted = f"a {NAME} of `toros unwrap`"
    names = (*ARRAYS, *NUMBERS)
    return on_first_rank(
        comm, lambda: read_archive(place, FORMAT, VERSION, names, wanted, pattern_of)
    )


@collective("comm")
def read_print(comm: MPI.Comm, path: Path | str) -> tuple[Pattern, Bools]:
    """Read a pattern and which of its triangles are printed, (t,) (collective).

    Args:
        comm: Communicator; the first rank reads.
        path: A file that a design wrote.

    Raises:
        PatternFileError: As for `read_pattern`, or the file does not say what is printed.
    """
    place = checked_path("path", path, PatternFileError)
    wanted = f"the {NAME} of a design"

    def make(entries: Mapping[str, Any]) -> tuple[Pattern, Bools]:
        pattern, printed = pattern_of(entries), entries.get(PRINTED)
        if printed is None or printed.dtype != bool or printed.shape != pattern.panel.shape:
            raise PatternFileError("it does not say which triangles are printed")
        return pattern, printed

    names = (*ARRAYS, *NUMBERS)
    return on_first_rank(comm, lambda: read_archive(place, FORMAT, VERSION, names, wanted, make))


def pattern_entries(pattern: Pattern) -> dict[str, Any]:
    """Return the entries of an archive that holds a pattern."""
    return {name: getattr(pattern, name) for name in (*ARRAYS, *NUMBERS)}


def pattern_of(entries: Mapping[str, Any]) -> Pattern:
    """Return the pattern that `pattern_entries` belong to; any error where they are no pattern."""
    arrays = {name: entries[name] for name in ARRAYS if name != "panel_names"}
    return Pattern(
        **arrays,
        panel_names=tuple(str(name) for name in entries["panel_names"]),
        seam_tolerance=float(entries["seam_tolerance"].item()),
        moulded=bool(entries["moulded"].item()),
    )


def read_archive(
    path: Path,
    kind: str,
    version: int,
    names: Sequence[str],
    wanted: str,
    make: Callable[[Mapping[str, Any]], T],
) -> T:
    """Read a NumPy archive that has a format and a version, and make something of it (one rank).

    Args:
        path: The file.
        kind: Its entry "format".
        version: The newest version of it that is known.
        names: Entries that it must have.
        wanted: File that the error advises.
        make: Makes the result of the entries; may raise where they are wrong.

    Raises:
        PatternFileError: There is no such file, it is another kind of file, of a newer version,
            lacks an entry, or `make` raises.
    """
    try:
        with np.load(path) as archive:
            entries = dict(archive)
    except UNREADABLE as caught:
        raise PatternFileError(f"{path} cannot be read: {reason(caught)}. Give {wanted}.") from None
    if str(entries.get("format")) != kind:
        raise PatternFileError(f"{path} is another kind of file. Give {wanted}.")
    missing = [name for name in ("version", *names) if name not in entries]
    if missing:
        raise PatternFileError(f"{path} lacks {', '.join(missing)}. Write {wanted} again.")
    try:
        found = int(entries["version"].item())
        made = make(entries) if found <= version else None
    except (TorosError, ValueError, TypeError, IndexError, OverflowError) as caught:
        raise PatternFileError(f"{path} is not valid: {caught}. Write {wanted} again.") from None
    if made is None:
        raise PatternFileError(
            f"{path} has version {found}; this toros_fem reads up to {version}. Update it."
        )
    return made
