"""Options of the commands that read a scene file, and of those that run one."""

from __future__ import annotations

import logging
from contextlib import AbstractContextManager
from dataclasses import MISSING, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import Count, File, Flag, Text, key
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.exit_codes import UsageError

if TYPE_CHECKING:
    from toros_fem.cli.scene_files.reading import SceneFile

log = logging.getLogger(__name__)


class Progress(Command, kw_only=True):
    """What is reported and stored while it runs."""

    every: Count = key(2, "iterations between two writes of the state")
    verbose: Flag = key(False, "print every Newton step")
    petsc: Text = key(
        "",
        "options of PETSc for the equilibrium solver, each with the prefix -toros_, as in the "
        "variable PETSC_OPTIONS: '-toros_snes_monitor -toros_snes_rtol 1e-8'",
    )

    TAKES: ClassVar = {"petsc": "OPTIONS"}

    def petsc_given(self) -> AbstractContextManager[None]:
        """Let PETSc have these options in a `with` block."""
        from toros_fem.mechanics.equilibrium.newton import given_options

        return given_options(self.petsc)


class Changes(Command, kw_only=True):
    """Changes of a scene's values."""

    set: tuple[Text, ...] = key(
        (),
        "another value of a key of the scene file, as it would stand there, in its unit or in SI "
        "units; may be given several times",
    )

    TAKES: ClassVar = {"set": "KEY=VALUE"}


class Meshes(Command, kw_only=True):
    """Large meshes."""

    allow_large: Flag = key(False, "also allow meshes of more than 2000000 triangles")

    def meshes_allowed(self) -> AbstractContextManager[None]:
        """Lift the limit on triangles inside a `with` block, if the options ask for it."""
        from toros_fem.meshes.triangles import MOST_TRIANGLES, triangle_limit

        return triangle_limit(None if self.allow_large else MOST_TRIANGLES)


class SceneCommand(Changes, Meshes, kw_only=True):
    """The scene and its quick variant."""

    file: File = key(MISSING, "scene file, by `toros new`")
    coarse: Flag = key(False, "the scene's quick variant: a coarse mesh and few steps")

    WORDS: ClassVar[tuple[str, ...]] = ("file",)

    def scene(self, comm: MPI.Comm) -> SceneFile:
        """Read the scene that the options name, and look for its files (collective)."""
        from toros_fem.cli.scene_files.reading import read_scene

        scene = read_scene(self.file, comm=comm, coarse=self.coarse, changes=self.set)
        scene.require_files(comm)
        if self.coarse and comm.rank == 0:
            known = scene.config.described()
            told = [
                f"{name} = {known[name].written(scene.config.value(name))} (not "
                f"{known[name].written(value)})"
                for name, value in scene.instead.items()
            ]
            log.info("--coarse takes %s", ", ".join(told) or "what stands there")
        return scene


class RunCommand(SceneCommand, Progress, kw_only=True):
    """The run's folder."""

    output: File | None = key(
        None,
        "folder of the run, made if missing, and refused if it is not empty; none: named after the "
        'file, for a simulation with "-simulated"',
    )
    overwrite: Flag = key(
        False, "replace the run in the folder: its own files are removed, all others stay"
    )
    metric: tuple[Text, ...] = key(
        (),
        'a number more to judge an own mesh by: "bend of z > 70 mm against z < 5 mm", as in the '
        "tables [[metric]] of its file; measures are bend, turn, twist, length, x, y, z, lean, and "
        "tip for the last four; may be given several times",
    )
    TAKES: ClassVar = {**SceneCommand.TAKES, **Progress.TAKES, "output": "RUN", "metric": "WORDS"}

    def scene(self, comm: MPI.Comm) -> SceneFile:
        """Read the scene that the options name, with the metrics that they add (collective)."""
        scene = super().scene(comm)
        if not self.metric:
            return scene
        from toros_fem.products.own_mesh.metrics import MetricTable
        from toros_fem.products.own_mesh.own_mesh import OwnMeshScene

        if not isinstance(scene.config, OwnMeshScene):
            raise UsageError(
                f"--metric is for own meshes; scenes of the kind {scene.kind.KIND!r} have "
                "metrics of their own."
            )
        metrics = (*scene.config.metric, *map(MetricTable.from_words, self.metric))
        return replace(scene, config=scene.config.updated(metric=metrics))

    def run(self, comm: MPI.Comm, scene: SceneFile, name: str, **files: Path | None) -> Answer:
        """Design or simulate a scene, with files given by options, in its folder (collective)."""
        from toros_fem.cli.command_line.running import files_of, run_scene

        given = {one: path for one, path in files.items() if path is not None}
        for one in given.keys() - files_of(scene, name):
            option = "--" + one.replace("_", "-")
            raise UsageError(
                f"toros {name}: scenes of the kind {scene.kind.KIND!r} take no {option}."
            )
        scene = replace(scene, files={**scene.files, **given})
        scene.require_files(comm)
        with self.meshes_allowed(), self.petsc_given():
            own = f"{self.file.stem}-simulated" if name == "simulate" else self.file.stem
            folder = self.output or Path(own)
            return run_scene(
                comm,
                scene,
                name,
                folder,
                overwrite=self.overwrite,
                every=self.every,
                verbose=self.verbose,
            )
