"""The command `toros`, also `python -m toros_fem`."""

from __future__ import annotations

import signal
import sys

from mpi4py import MPI

from toros_fem.cli.commands.main import run


def main() -> int:
    """Run the command that the command line names, on all ranks; return the exit code."""
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc would end all ranks
    return run(MPI.COMM_WORLD, sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
