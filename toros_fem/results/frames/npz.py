"""Arrays in npz files: written whole or not at all, read without pickled objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import OutputError
from toros_fem.base.files import UNREADABLE, reason, replace_file

REMEDY = "Delete it, or run the design again."

Arrays = Mapping[str, npt.NDArray]


def write_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays to an npz file that is never seen half written (one rank).

    Raises:
        OSError: It cannot be written.
    """
    stream = BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    replace_file(path, stream.getvalue())


def read_arrays(path: Path, names: Sequence[str]) -> dict[str, npt.NDArray]:
    """Return the arrays of an npz file.

    Args:
        path: The file.
        names: Names of the arrays that it must hold.

    Raises:
        OutputError: The file is no such file, or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
    except UNREADABLE as caught:
        raise OutputError(f"{path} cannot be read: {reason(caught)}. {REMEDY}") from None
    require_arrays(path, arrays, names)
    return arrays


def require_arrays(path: Path, arrays: Arrays, names: Sequence[str]) -> None:
    """Check that a file held some arrays.

    Raises:
        OutputError: One is missing.
    """
    missing = [name for name in names if name not in arrays]
    if missing:
        raise OutputError(f"{path} holds no {missing[0]!r}. {REMEDY}")
