"""`toros tolerance`: what a finished design does that is not made as drawn."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.keys import key
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.products.options import ToleranceConfig


@dataclass(frozen=True, kw_only=True)
class Tolerance(Command, ToleranceConfig):
    """Simulates a print with wrong widths, materials and pressure.

    Lines are wider or narrower than drawn, materials stiffer or softer, the pressure is another.
    Each change is simulated alone. The command names the change that matters most. The folder
    gets tolerance.json, tolerance.csv and tolerance.png.
    """

    run: Path = key(MISSING, "folder of a finished design")
    output: Path | None = key(
        None,
        "folder for the files, made if missing; none takes RUN, where `toros view` shows them",
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
        from toros_fem.cli.scene_files.scene_of_run import scene_of_run
        from toros_fem.meshes.triangles import triangle_limit
        from toros_fem.products.tolerance.of_run import tolerances_of_run
        from toros_fem.products.tolerance.writing import FILES, write_tolerances

        output = self.output or self.run
        with triangle_limit(None):  # what was designed was allowed
            scene, files = scene_of_run(comm, self.run)
            found = tolerances_of_run(
                comm, self.run, scene, files, self.updating(ToleranceConfig())
            )
        write_tolerances(comm, output, found)
        text = f"{found.report()}; see {output}/{FILES[2]}"
        return Answer(text, {"folder": output, "files": FILES, **found.summary()})
