"""`toros design`: a pattern for a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import File, Flag, key
from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.exit_codes import UsageError
from toros_fem.cli.command_line.scene_options import RunCommand

if TYPE_CHECKING:
    from toros_fem.cli.scene_files.reading import SceneFile


class Design(RunCommand, kw_only=True):
    """Designs the pattern of a scene.

    The pattern is designed, cleaned so that it can be printed, simulated again and written,
    with pictures and all figures in summary.json. The state is written while it runs: a run
    that was stopped goes on by `toros resume`.
    """

    start_from: File | None = key(
        None,
        "folder of a finished design: the densities start from its print, which may have another "
        "size, target or pressure, on the finest mesh; none: the scene's start",
    )

    final: Flag = key(
        False,
        "the design to trust: fine meshes, figures from a finer one, and up to three seeds until a "
        "print certainly reaches its targets; what it costs is told first",
    )

    TAKES: ClassVar = {**RunCommand.TAKES, "start_from": "DESIGN"}
    EXAMPLES: ClassVar = (
        "toros design mine.toml --output run",
        "toros design mine.toml --output quick --coarse",
        "toros design mine.toml --output best --final",
        "toros design mine.toml --output other --set angle=90",
        "toros design mine.toml --output more --set angle=120 --start-from other",
        "mpirun -n 2 toros design mine.toml --output run",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Design in the run's folder (collective)."""
        scene = self.scene(comm)
        if self.final:
            scene = self._finally(comm, scene)
        return self.run(comm, scene, "design", start_from=self.start_from)

    def _finally(self, comm: MPI.Comm, scene: SceneFile) -> SceneFile:
        """Return the final variant of a scene, and tell its cost (collective)."""
        from toros_fem.base.units import duration
        from toros_fem.cli.commands.check import cost_lines
        from toros_fem.products.actuators.cost import expected_time
        from toros_fem.products.actuators.scene import ActuatorScene
        from toros_fem.results.reporter import print_line

        if self.coarse:
            raise UsageError("--coarse is a preview, and --final is not: leave one of them out.")
        if not isinstance(scene.config, ActuatorScene):
            raise UsageError(f"scenes of the kind {scene.kind.KIND!r} have no --final.")
        config = scene.config.final()
        scene = replace(scene, config=config)
        with self.meshes_allowed(), scene.located():
            read = config.with_files(comm, scene.files)
            cost = read.expected_cost(comm)
            low, high = map(duration, expected_time(comm, read, cost))
        if comm.rank == 0:
            ranks = f"{comm.size} rank{'s' * (comm.size > 1)}"
            lines = [*cost_lines(comm, cost), f"time        {low} to {high} on {ranks}"]
            print_line("\n".join(lines))
        return scene
