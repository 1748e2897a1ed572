"""`toros resume`: a run goes on where it was stopped."""

from __future__ import annotations

from dataclasses import MISSING
from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.keys import File, key
from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.scene_options import Changes, Meshes, Progress


class Resume(Changes, Meshes, Progress, kw_only=True):
    """Continues a run that was stopped, or one that should go further.

    The run continues from its last state, with the inputs that it began with (RUN/scene.toml), on
    any number of ranks. On the same number its result is the same to the last digit. By --set it
    takes other numbers of steps and corrections, another curve, other tolerances or a check on a
    finer mesh, by which other lines may be printed; a finished run then goes on too. For other
    changes start a new run.
    """

    run: File = key(MISSING, "folder of the run")

    WORDS: ClassVar = ("run",)
    TAKES: ClassVar = {**Changes.TAKES, **Progress.TAKES}
    EXAMPLES: ClassVar = (
        "toros resume run",
        "toros resume run --set corrections=3 --set curve_pressure='30 kPa'",
        "mpirun -n 2 toros resume run",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Go on with the run (collective)."""
        from toros_fem.cli.command_line.running import resume_scene
        from toros_fem.meshes.triangles import triangle_limit

        # What the run began with was allowed.
        allowed = self.meshes_allowed() if self.set else triangle_limit(None)
        with self.petsc_given(), allowed:
            return resume_scene(comm, self.run, self.set, every=self.every, verbose=self.verbose)
