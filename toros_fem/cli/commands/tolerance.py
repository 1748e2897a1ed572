"""`toros tolerance`: what a finished design does that is not made as drawn."""

from __future__ import annotations

from dataclasses import MISSING
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from mpi4py import MPI

from toros_fem.base.files import require_unused
from toros_fem.base.keys import File, Flag, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command import Answer, Command
from toros_fem.products.common.options import ToleranceConfig

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import ActuatorScene


class Tolerance(Command, ToleranceConfig, kw_only=True):
    """Simulates a print with wrong widths, materials and pressure.

    Lines are wider or narrower than drawn, materials stiffer or softer, the pressure is another.
    Each change is simulated alone. The command names the change that matters most. The folder
    gets tolerance.json, tolerance.csv and tolerance.png.
    """

    run: File = key(MISSING, "folder of a finished design")
    output: File | None = key(
        None,
        "folder for the files, made if missing; none takes RUN, where `toros view` shows them",
    )
    overwrite: Flag = key(
        False, "replace files of these names in another folder than RUN; all others stay"
    )

    WORDS: ClassVar = ("run",)
    TAKES: ClassVar = {"output": "FOLDER"}
    EXAMPLES: ClassVar = (
        "toros tolerance run",
        'toros tolerance run --width "0.2 mm" --thickness 0.1',
        "mpirun -n 2 toros tolerance run --output worn --json",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Simulate the variants, and write them (collective)."""
        from toros_fem.meshes.triangles import triangle_limit
        from toros_fem.products.tolerance_of_run import FILES, tolerances_of_run, write_tolerances

        output = self.output or self.run
        if self.output is not None:
            unused = partial(require_unused, output, FILES, overwrite=self.overwrite)
            on_first_rank(comm, unused)
        with triangle_limit(None):  # what was designed was allowed
            scene, files = scene_of_run(comm, self.run)
            found = tolerances_of_run(
                comm, self.run, scene, files, self.updating(ToleranceConfig())
            )
        write_tolerances(comm, output, found)
        text = f"{found.report()}; see {output}/{FILES[2]}"
        return Answer(text, {"folder": output, "files": FILES, **found.summary()})


def scene_of_run(comm: MPI.Comm, run: Path | str) -> tuple[ActuatorScene, dict[str, Path]]:
    """Return scene and files of a finished design of an actuator (collective)."""
    from toros_fem.base.errors import FileError
    from toros_fem.base.mpi import on_first_rank
    from toros_fem.cli.scene_files import read_scene
    from toros_fem.products.actuators.scene import ActuatorScene
    from toros_fem.products.kinds import KINDS
    from toros_fem.products.tolerance_of_run import finished_summary
    from toros_fem.results.runs.stored_run import SCENE

    folder = Path(run)
    on_first_rank(comm, lambda: finished_summary(folder))
    if not on_first_rank(comm, lambda: (folder / SCENE).exists()):
        raise FileError(
            f"{folder} does not say which scene it is of: {SCENE} is missing. Design it by "
            "`toros design`, or use toros_fem.tolerances or force_map in your own script."
        )
    read = read_scene(folder / SCENE, comm=comm)
    read.require_files(comm)
    if not isinstance(read.config, ActuatorScene):
        raise FileError(
            f"{folder} is a run of the kind {read.kind.KIND!r}; this command takes designs of "
            f"{', '.join(name for name, of in KINDS.items() if issubclass(of, ActuatorScene))}."
        )
    return read.config, dict(read.files)
