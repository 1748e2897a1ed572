"""`toros design`: a pattern for a scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.keys import key
from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.scene_options import RunCommand


@dataclass(frozen=True, kw_only=True)
class Design(RunCommand):
    """Designs the pattern of a scene.

    The pattern is designed, cleaned so that it can be printed, simulated again and written,
    with pictures and all figures in summary.json. The state is written while it runs: a run
    that was stopped goes on by `toros resume`.
    """

    start_from: Path | None = key(
        None,
        "folder of a finished design: the densities start from its print, which may have another "
        "size, target or pressure, on the finest mesh; none: the scene's start",
    )

    TAKES: ClassVar = {**RunCommand.TAKES, "start_from": "DESIGN"}
    EXAMPLES: ClassVar = (
        "toros design mine.toml --output run",
        "toros design mine.toml --output quick --coarse",
        "toros design mine.toml --output other --set angle=90",
        "toros design mine.toml --output more --set angle=120 --start-from other",
        "mpirun -n 2 toros design mine.toml --output run",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Design in the run's folder (collective)."""
        return self.run(comm, self.scene(comm), "design", start_from=self.start_from)
