"""Mesh files read by meshio, without its output, and the lines of OBJ files that it ignores."""

from __future__ import annotations

import contextlib
import io
import itertools
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from toros_fem.base.array_types import Ints
from toros_fem.base.errors import SurfaceError, TorosError
from toros_fem.meshes.time_limit import TimeLimitError, within

# Some of meshio's readers look for the next line of a file that has ended, and never return. These
# times in s are far beyond those of good files.
SECONDS, SECONDS_PER_MEGABYTE = 5.0, 60.0
# Characters of the longest message of meshio that is passed on.
LONGEST = 160


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
            limit = SECONDS + SECONDS_PER_MEGABYTE * path.stat().st_size / 1e6
            return within(limit, lambda: meshio.read(path))
    except ImportError as error:
        raise failure(
            f"{path} cannot be read as a mesh, since meshio lacks a package for its format "
            f"({error}). Save it as {formats}, or install that package."
        ) from error
    except TimeLimitError:
        raise failure(
            f"{path} cannot be read as a mesh in a reasonable time: it ends too early, or its "
            f"counts are wrong. Save it again, as {formats}."
        ) from None
    except (Exception, SystemExit) as error:
        why = " ".join((printed.getvalue().strip() or f"{type(error).__name__}: {error}").split())
        why = why if len(why) <= LONGEST else f"{why[:LONGEST]} …"
        raise failure(f"{path} cannot be read as a mesh ({why}). Save it as {formats}.") from error


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
