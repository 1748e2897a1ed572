"""A sewing pattern as a file: panels, seams, and the assembled shape."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from mpi4py import MPI

from toros_fem._mpi import on_first_rank
from toros_fem._types import Bools
from toros_fem.errors import PatternFileError, TorosError
from toros_fem.meshes.pattern import Pattern

NAME = "pattern.npz"
FORMAT = "toros_fem pattern"
VERSION = 1
PRINTED = "printed"
ARRAYS = ("flat_points", "flat_triangles", "panel", "sewn", "points", "panel_names")
NUMBERS = ("seam_tolerance", "moulded")


def write_pattern(path: Path | str, pattern: Pattern, printed: Bools | None = None) -> None:
    """Write a pattern as a compressed NumPy archive (one rank).

    Its entries are the fields of `Pattern` by name, lengths in m, with "format" and "version", and
    "printed" where it is given.

    Args:
        path: File ending in .npz.
        pattern: The pattern.
        printed: Whether each triangle is printed, (t,); None leaves it out.
    """
    entries: dict[str, Any] = {name: getattr(pattern, name) for name in (*ARRAYS, *NUMBERS)}
    if printed is not None:
        entries[PRINTED] = printed
    np.savez_compressed(path, format=FORMAT, version=VERSION, **entries)


def read_pattern(comm: MPI.Comm, path: Path | str) -> Pattern:
    """Read the pattern that `write_pattern` wrote, the same on all ranks (collective).

    Args:
        comm: Communicator; the first rank reads.
        path: The file.

    Raises:
        PatternFileError: There is no such file, it is another kind of file, of a newer version,
            lacks an entry, or holds no valid pattern.
    """
    path = Path(path)
    return on_first_rank(comm, lambda: _read(path)[0])


def read_print(comm: MPI.Comm, path: Path | str) -> tuple[Pattern, Bools]:
    """Read a pattern and which of its triangles are printed, (t,) (collective).

    Args:
        comm: Communicator; the first rank reads.
        path: A file that a design wrote.

    Raises:
        PatternFileError: As for `read_pattern`, or the file does not say what is printed.
    """
    path = Path(path)

    def read() -> tuple[Pattern, Bools]:
        pattern, entries = _read(path)
        printed = entries.get(PRINTED)
        if printed is None or printed.dtype != bool or printed.shape != pattern.panel.shape:
            raise PatternFileError(
                f"{path} does not say which triangles are printed. Give the {NAME} of a design."
            )
        return pattern, printed

    return on_first_rank(comm, read)


def _read(path: Path) -> tuple[Pattern, dict[str, Any]]:
    try:
        with np.load(path) as archive:
            entries = dict(archive)
    # np.load raises these for a lone array and for other kinds of files.
    except (OSError, ValueError, EOFError, TypeError, BadZipFile, zlib.error) as caught:
        raise PatternFileError(
            f"{path} cannot be read: {caught}. Give a {NAME} of `toros unwrap`."
        ) from None
    if str(entries.get("format")) != FORMAT:
        raise PatternFileError(f"{path} is no pattern. Give a {NAME} of `toros unwrap`.")
    missing = [name for name in ("version", *ARRAYS, *NUMBERS) if name not in entries]
    if missing:
        raise PatternFileError(f"{path} lacks {', '.join(missing)}. Unwrap the surface again.")
    try:
        return _pattern(path, entries), entries
    except PatternFileError:
        raise
    except (TorosError, ValueError, TypeError, IndexError, OverflowError) as caught:
        raise PatternFileError(f"{path} holds no valid pattern: {caught}") from None


def _pattern(path: Path, entries: dict[str, Any]) -> Pattern:
    version = int(entries["version"].item())
    if version > VERSION:
        raise PatternFileError(
            f"{path} has version {version}; this toros_fem reads up to {VERSION}. Update it."
        )
    arrays = {name: entries[name] for name in ARRAYS if name != "panel_names"}
    return Pattern(
        **arrays,
        panel_names=tuple(str(name) for name in entries["panel_names"]),
        seam_tolerance=float(entries["seam_tolerance"].item()),
        moulded=bool(entries["moulded"].item()),
    )
