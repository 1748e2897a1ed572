"""Mesh files read by meshio, without its output, and the lines of OBJ files that it ignores."""

from __future__ import annotations

import contextlib
import io
import itertools
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from toros_fem._types import Ints
from toros_fem.errors import SurfaceError, TorosError


def load(path: Path, failure: type[TorosError], formats: str) -> Any:
    """Read a mesh file by meshio.

    Where meshio cannot read a file, it prints, and may call `sys.exit`: both become an error.

    Args:
        path: The file.
        failure: Type of the error to raise.
        formats: Formats that the error suggests, such as "OBJ or PLY".

    Raises:
        TorosError: Of the type `failure`. There is no such file, or it cannot be read.
    """
    if not path.is_file():
        raise failure(f"there is no file {path}.")
    printed = io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
            np.errstate(over="ignore"),
        ):
            return meshio.read(path)
    except ImportError as error:
        raise failure(
            f"{path} cannot be read as a mesh, since meshio lacks a package for its format "
            f"({error}). Save it as {formats}, or install that package."
        ) from error
    except (Exception, SystemExit) as error:
        why = printed.getvalue().strip() or f"{type(error).__name__}: {error}"
        raise failure(
            f"{path} cannot be read as a mesh ({' '.join(why.split())}). Save it as {formats}."
        ) from error


def obj_lines(path: Path) -> Ints:
    """Read the ends of the line elements of an OBJ file, (k, 2), which meshio ignores.

    Raises:
        SurfaceError: A line element does not give its vertices as numbers.
    """
    ends: list[tuple[int, int]] = []
    vertices = 0
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            word = line.split()
            if word[:1] == ["v"]:
                vertices += 1
            if word[:1] != ["l"]:
                continue
            try:
                chain = [int(item.split("/")[0]) for item in word[1:]]
            except ValueError as error:
                raise SurfaceError(
                    f"line {number} of {path}, {line.strip()!r}, does not give vertices as "
                    "numbers. Export it again, or delete the line."
                ) from error
            # Negative numbers count back from the last vertex so far.
            ends += itertools.pairwise(k - 1 if k >= 0 else vertices + k for k in chain)
    return np.array(ends, dtype=np.int64).reshape(-1, 2)
