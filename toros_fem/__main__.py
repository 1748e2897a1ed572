"""The command `toros`, also `python -m toros_fem`."""

from __future__ import annotations

import signal
import sys

from mpi4py import MPI

from toros_fem.cli.commands.main import loaded, named, run


def main() -> int:
    """Run the command that the command line names, on all ranks; return the exit code."""
    words = sys.argv[1:]
    if (name := named(words)) is not None:
        loaded(name)  # and PETSc with it, which would end all ranks where a pipe breaks
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    return run(MPI.COMM_WORLD, words)


if __name__ == "__main__":
    sys.exit(main())
