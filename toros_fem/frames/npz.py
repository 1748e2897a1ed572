"""Arrays in npz files: written whole or not at all, read without pickled objects."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from toros_fem.errors import OutputError

Arrays = Mapping[str, npt.NDArray]


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays to an npz file, under a temporary name first (one rank)."""
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
    os.replace(partial, path)


def read_arrays(path: Path) -> dict[str, npt.NDArray]:
    """Return the arrays of an npz file.

    Raises:
        OutputError: The file is no such file, or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as caught:
        raise OutputError(
            f"{path} cannot be read: {caught}. Delete it; the report does without it."
        ) from None
