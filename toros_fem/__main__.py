"""The command `toros`, also `python -m toros_fem`."""

from __future__ import annotations

import os
import sys

from toros_fem.cli.command_line.places import use_writable_places
from toros_fem.cli.needs import tell_missing


def main() -> int:
    """Run the command that the command line names, on all ranks; return the exit code."""
    use_writable_places()
    # PETSc would end all ranks where a pipe breaks, a signal that Python ignores.
    os.environ["PETSC_OPTIONS"] = f"{os.environ.get('PETSC_OPTIONS', '')} -no_signal_handler"
    try:
        from mpi4py import MPI

        from toros_fem.cli.commands.main import run
    except (ImportError, RuntimeError) as error:  # mpi4py without an MPI raises the second
        return tell_missing(sys.argv[1:], error)
    return run(MPI.COMM_WORLD, sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
