"""The scene of a finished design, from what its folder holds."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from toros_fem.base.errors import OutputError
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.scene_files.reading import read_scene
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.kinds import KINDS
from toros_fem.products.tolerance.of_run import finished_summary
from toros_fem.results.runs.files import SCENE


def scene_of_run(comm: MPI.Comm, run: Path | str) -> tuple[ActuatorScene, dict[str, Path]]:
    """Return scene and files of a design (collective).

    Raises:
        OutputError: The folder holds no finished design, or that of no actuator.
    """
    folder = Path(run)
    on_first_rank(comm, lambda: finished_summary(folder))
    if not on_first_rank(comm, lambda: (folder / SCENE).exists()):
        raise OutputError(
            f"{folder} does not say which scene it is of: {SCENE} is missing. Design it by "
            "`toros design`, or call toros_fem.tolerances from your own script."
        )
    read = read_scene(folder / SCENE, comm=comm)
    read.require_files(comm)
    if not isinstance(read.config, ActuatorScene):
        raise OutputError(
            f"{folder} is a run of the kind {read.kind.KIND!r}; tolerances are those of designs of "
            f"{', '.join(name for name, of in KINDS.items() if issubclass(of, ActuatorScene))}."
        )
    return read.config, dict(read.files)
