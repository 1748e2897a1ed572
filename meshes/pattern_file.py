"""A sewing pattern as a file: panels, seams, and the assembled shape."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.array_types import Bools
from toros_fem.base.errors import FileError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import checked_path, require_kind, shown
from toros_fem.meshes.pattern import Pattern

NAME, KIND = "pattern.npz", "pattern"
ARRAYS = ("flat_points", "flat_triangles", "panel", "sewn", "points")
NUMBERS = ("panel_names", "seam_tolerance", "moulded")
PRINTED = "printed"


def write_pattern(path: Path | str, pattern: Pattern, printed: Bools | None = None) -> None:
    """Write a pattern as an archive, a file ending in .npz (one rank).

    Its entries are the fields of `Pattern` by name, lengths in m, and "printed" where it is given:
    whether each triangle is printed, (t,).

    Raises:
        FileError: The path does not end in .npz.
    """
    path = checked_path("path", path, FileError)
    if path.suffix != ".npz":
        raise FileError(f"path = {shown(str(path))} must end in .npz.")
    require_kind("pattern", pattern, Pattern, "a Pattern")
    write_archive(path, archive_of(KIND, pattern, {} if printed is None else {PRINTED: printed}))


@on_root
def read_pattern(comm: MPI.Comm, path: Path | str) -> Pattern:
    """Read the pattern that `write_pattern` wrote, the same on all ranks (collective).

    Raises:
        FileError: There is no such file, it is damaged, of another kind or format, or holds
            no valid pattern.
    """
    place = checked_path("path", path, FileError)
    remedy = f"Give a {NAME} of `toros unwrap`."
    return read_archive(place, KIND, pattern_of, FileError, remedy)


@on_root
def read_print(comm: MPI.Comm, path: Path | str) -> tuple[Pattern, Bools]:
    """Read a pattern of a design and which of its triangles are printed, (t,) (collective).

    Raises:
        FileError: As for `read_pattern`, or the file does not say what is printed.
    """
    place = checked_path("path", path, FileError)
    remedy = f"Give the {NAME} of a design."

    def make(archive: Archive) -> tuple[Pattern, Bools]:
        pattern, printed = pattern_of(archive), archive.arrays.get(PRINTED)
        if printed is None or printed.dtype != bool or printed.shape != pattern.panel.shape:
            raise FileError("it does not say which triangles are printed")
        return pattern, printed

    return read_archive(place, KIND, make, FileError, remedy)


def archive_of(
    kind: str, pattern: Pattern, arrays: Mapping[str, Any], numbers: Mapping[str, Any] | None = None
) -> Archive:
    """Return an archive of a pattern and of what belongs to it."""
    own = {name: getattr(pattern, name) for name in ARRAYS}
    more = {name: getattr(pattern, name) for name in NUMBERS}
    given = {name: np.asarray(array) for name, array in arrays.items()}
    return Archive(kind, {**own, **given}, {**more, **(numbers or {})})


def pattern_of(archive: Archive) -> Pattern:
    """Return the pattern in an archive; any error where there is none."""
    arrays = {name: archive.arrays[name] for name in ARRAYS}
    names, tolerance, moulded = (archive.numbers[name] for name in NUMBERS)
    return Pattern(**arrays, panel_names=tuple(names), seam_tolerance=tolerance, moulded=moulded)
