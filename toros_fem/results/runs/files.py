"""Files that are whole or absent: replaced at once, and checkpoints that are told from others."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from toros_fem.base.errors import CheckpointError
from toros_fem.base.files import reason, replace_file
from toros_fem.base.versions import __version__
from toros_fem.design.loop.journal import Checkpoint

# Version of the format; a file of another one is refused.
FORMAT = 2
# Key of the header among the arrays of a file, and how its content begins.
HEADER, MAGIC = "header", "toros_fem checkpoint"


def write_checkpoint(path: Path, checkpoint: Checkpoint, belongs_to: Mapping[str, str]) -> None:
    """Write a checkpoint as .npz without pickled objects (one rank).

    Args:
        path: The file.
        checkpoint: The checkpoint.
        belongs_to: What tells it from a foreign one.

    Raises:
        OSError: It cannot be written; an earlier one stays.
    """
    header = {
        "is": MAGIC,
        "format": FORMAT,
        "toros_fem": __version__,
        "belongs_to": dict(belongs_to),
        "numbers": checkpoint.numbers,
    }
    text = json.dumps(header, ensure_ascii=False).encode()
    out = io.BytesIO()
    np.savez(out, **{HEADER: np.frombuffer(text, np.uint8), **checkpoint.arrays})  # type: ignore[arg-type]
    replace_file(path, out.getvalue())


def read_checkpoint(path: Path, belongs_to: Mapping[str, str]) -> tuple[Checkpoint, str]:
    """Read a checkpoint; return it and the version of the package that wrote it (one rank).

    Args:
        path: The file.
        belongs_to: What it must belong to.

    Raises:
        CheckpointError: The file is damaged, of another version, or belongs to something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            header = json.loads(bytes(file[HEADER]))
            arrays = {name: file[name] for name in file.files if name != HEADER}
            known, found = header["is"] == MAGIC, int(header["format"])
            owner, numbers = dict(header["belongs_to"]), dict(header["numbers"])
            written_by = str(header["toros_fem"])
    except Exception as fault:  # a damaged file may raise anything
        raise CheckpointError(
            f"{path} is no whole checkpoint ({type(fault).__name__}: {reason(fault)}). Remove it "
            "to lose this part of the run alone, or start the run anew."
        ) from None
    if known and found != FORMAT:
        raise CheckpointError(
            f"{path} has format {found}, written by toros_fem {written_by}; this is {__version__} "
            f"and reads format {FORMAT}. Go on with that version, or start the run anew."
        )
    if not known or owner != dict(belongs_to):
        differing = [key for key, value in belongs_to.items() if owner.get(key) != value]
        raise CheckpointError(
            f"{path} belongs to another run: its {', '.join(differing) or 'kind'} is another. "
            "Resume with the inputs that the run began with, or start anew."
        )
    return Checkpoint(arrays, numbers), written_by


def version() -> str:
    """Return the version of the package."""
    return __version__
