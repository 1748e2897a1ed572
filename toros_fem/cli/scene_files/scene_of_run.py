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
from toros_fem.results.runs.folder import SCENE, SUMMARY


def scene_of_run(comm: MPI.Comm, run: Path | str) -> tuple[ActuatorScene, dict[str, Path]]:
    """Return scene and files of a design (collective).

    A script leaves no scene file: its kind is the one with the same numbers.

    Raises:
        OutputError: The folder holds no finished design, or that of no actuator.
    """
    folder = Path(run)
    summary = on_first_rank(comm, lambda: finished_summary(folder))
    if on_first_rank(comm, lambda: (folder / SCENE).exists()):
        scene = read_scene(folder / SCENE, comm=comm)
        scene.require_files(comm)
        kind, config, files = scene.kind, scene.config, dict(scene.files)
    else:
        given = summary.get("inputs") or {}
        names = set(given)
        # A run of an older version may lack numbers that have come since.
        known = [k for k in KINDS.values() if names and names <= set(k().as_dict())]
        if not known:
            raise OutputError(
                f"{folder} does not say which scene it is of: {SCENE} is missing, and the inputs "
                f"in {SUMMARY} are those of no kind. Design it by `toros design`, or call "
                "toros_fem.tolerances from your own script."
            )
        kind = min(known, key=lambda k: len(k().as_dict()))
        config, files = kind().updated(**given), {}
    if not isinstance(config, ActuatorScene):
        raise OutputError(
            f"{folder} is a run of the kind {kind.KIND!r}; tolerances are those of designs of "
            f"{', '.join(name for name, k in KINDS.items() if issubclass(k, ActuatorScene))}."
        )
    return config, files
