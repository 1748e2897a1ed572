"""Exit codes of `toros`, those of errors, and the report of an error of one rank alone."""

from __future__ import annotations

import sys
import traceback
from typing import TYPE_CHECKING

from toros_fem.base.errors import (
    NoEquilibriumError,
    OutputError,
    RunStoppedError,
    TorosError,
)
from toros_fem.cli import needs

if TYPE_CHECKING:
    from mpi4py import MPI


class UsageError(TorosError, ValueError):
    """The command line is not understood; the message names the word and the nearest known one."""


DONE = 0
INTERNAL = 1
WRONG_INPUT = 2
NO_EQUILIBRIUM = 3
NOT_WRITTEN = 4
MISSING = needs.MISSING
INTERRUPTED = 130

MEANING = {
    DONE: "done",
    INTERNAL: "an error of the program; please report it",
    WRONG_INPUT: "wrong input: an option, a file or a value",
    NO_EQUILIBRIUM: "no equilibrium was found, or the design failed",
    NOT_WRITTEN: "a folder or file cannot be written or is in use",
    MISSING: needs.MEANING,
    INTERRUPTED: "stopped by Ctrl-C (SIGINT); the state of a design is written",
    140: "stopped by SIGUSR2, which mpirun passes on; the state of a design is written",
    143: "stopped by SIGTERM; the state of a design is written",
}


def exit_code(error: BaseException) -> int:
    """Return the exit code of an error."""
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    if isinstance(error, NoEquilibriumError):
        return NO_EQUILIBRIUM
    if isinstance(error, RunStoppedError):
        return 128 + error.signal
    if isinstance(error, OutputError):
        return NOT_WRITTEN
    if isinstance(error, TorosError):
        return WRONG_INPUT
    if isinstance(error, ImportError):
        own = (error.name or "toros_fem").startswith("toros_fem")
        return INTERNAL if own else MISSING
    return INTERNAL


def tell_alone(comm: MPI.Comm, error: Exception) -> None:
    """Print an error that this rank has and others have not."""
    text = f"{type(error).__name__}: {error}"
    if not isinstance(error, TorosError):
        text = "".join(traceback.format_exception(error))
    print(f"rank {comm.rank} alone: {text}", file=sys.stderr, flush=True)
