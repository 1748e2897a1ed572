"""`toros resume`: a run goes on where it was stopped."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.keys import key
from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.scene_options import Progress


@dataclass(frozen=True, kw_only=True)
class Resume(Progress):
    """Continues a run that was stopped.

    The run continues from its last state, with the inputs that it began with (RUN/scene.toml), on
    any number of ranks. On the same number its result is the same to the last digit.
    """

    run: Path = key(MISSING, "folder of the run")

    WORDS: ClassVar = ("run",)
    EXAMPLES: ClassVar = ("toros resume run", "mpirun -n 2 toros resume run")

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Go on with the run (collective)."""
        from toros_fem.cli.command_line.running import resume_scene
        from toros_fem.meshes.triangles import triangle_limit

        with self.petsc_given(), triangle_limit(None):  # what the run began with was allowed
            return resume_scene(comm, self.run, every=self.every, verbose=self.verbose)
