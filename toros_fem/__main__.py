"""The command `toros`, also `python -m toros_fem`."""

from __future__ import annotations

import os
import sys

from toros_fem.cli.command_line.places import use_writable_places


def main() -> int:
    """Run the command that the command line names, on all ranks; return the exit code."""
    use_writable_places()
    from mpi4py import MPI

    from toros_fem.cli.commands.main import run

    # PETSc would end all ranks where a pipe breaks, a signal that Python ignores.
    os.environ["PETSC_OPTIONS"] = f"{os.environ.get('PETSC_OPTIONS', '')} -no_signal_handler"
    return run(MPI.COMM_WORLD, sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
