"""The command `toros`, also `python -m toros_fem`."""

from __future__ import annotations

import os
import sys

from toros_fem.cli.process import tell_missing, use_writable_places

# Variables of processes that an MPI, or a batch system, starts together.
OF_RANKS = ("OMPI_COMM_WORLD_SIZE", "PMI_RANK", "PMIX_RANK", "SLURM_PROCID", "MPI_LOCALNRANKS")


def main() -> int:
    """Run the command that the command line names, on all ranks; return the exit code."""
    words = sys.argv[1:]
    try:
        from toros_fem.cli.commands.main import help_at_once, run

        if words in (["--help"], ["-h"], ["--version"]) and not _among_ranks():
            return help_at_once(words[0])
        use_writable_places()
        # PETSc would end all ranks where a pipe breaks, a signal that Python ignores.
        os.environ["PETSC_OPTIONS"] = f"{os.environ.get('PETSC_OPTIONS', '')} -no_signal_handler"
        from mpi4py import MPI

        import toros_fem.cli.command  # noqa: F401  # what all commands need
    except (ImportError, RuntimeError) as error:  # mpi4py without an MPI raises the second
        return tell_missing(words, error)
    return run(MPI.COMM_WORLD, words)


def _among_ranks() -> bool:
    return any(name in os.environ for name in OF_RANKS)


if __name__ == "__main__":
    sys.exit(main())
