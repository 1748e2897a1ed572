"""`toros simulate`: a plain skin or a given pattern, inflated."""

from __future__ import annotations

from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.keys import File, key
from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.scene_options import RunCommand


class Simulate(RunCommand, kw_only=True):
    """Inflates a plain skin or a given pattern.

    The pressure rises to the scene's in curve_steps equal steps. The run's folder gets
    summary.json, curve.csv, skin.vtu and pictures.
    """

    pattern: File | None = key(
        None,
        "folder of a finished design whose print is simulated; none: the skin where only what the "
        "scene prescribes is printed",
    )

    TAKES: ClassVar = {**RunCommand.TAKES, "pattern": "DESIGN"}
    EXAMPLES: ClassVar = (
        "toros simulate mine.toml --output plain",
        'toros simulate mine.toml --output other --pattern designed --set pressure="8 kPa"',
        "mpirun -n 2 toros simulate mine.toml --output plain --coarse",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Simulate in the run's folder (collective)."""
        return self.run(comm, self.scene(comm), "simulate", pattern=self.pattern)
