"""`toros force`: how the free end of a finished design pushes, and how stiff it is."""

from __future__ import annotations

from dataclasses import MISSING
from functools import partial
from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.files import require_unused
from toros_fem.base.keys import File, Flag, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command import Answer, Command
from toros_fem.products.common.options import ForceOptions


class Force(Command, ForceOptions, kw_only=True):
    """Says how the free end of a design pushes if blocked, and how stiff it is.

    The end is inflated as a free rigid plate, which gives a place at each pressure. It is then held
    at rest and at each of these places, while the pressure rises: force and torque. Stiffness of
    the free end, air volume and the least work of a pump are told too. The folder gets force.json,
    force.csv (place, pressure, force, torque: for simulators and controllers) and force.png.
    """

    run: File = key(MISSING, "folder of a finished design")
    output: File | None = key(None, "folder for the files, made if missing; none takes RUN")
    overwrite: Flag = key(
        False, "replace files of these names in another folder than RUN; all others stay"
    )

    WORDS: ClassVar = ("run",)
    TAKES: ClassVar = {"output": "FOLDER"}
    EXAMPLES: ClassVar = (
        "toros force run",
        "toros force run --turns free --steps 8",
        'toros force run --pressure "10 kPa" --without-intervals --json',
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Simulate the blocked end, and write its forces (collective)."""
        from toros_fem.cli.commands.tolerance import scene_of_run
        from toros_fem.meshes.triangles import triangle_limit
        from toros_fem.products.force import (
            FILES,
            forces_of_run,
            sentence_of,
            summary_of_forces,
            write_forces,
        )

        output = self.output or self.run
        if self.output is not None:
            unused = partial(require_unused, output, FILES, overwrite=self.overwrite)
            on_first_rank(comm, unused)
        options = self.updating(ForceOptions())
        with triangle_limit(None):  # what was designed was allowed
            scene, files = scene_of_run(comm, self.run)
            found = forces_of_run(comm, self.run, scene, files, options)
        direction = options.vector("direction")
        write_forces(comm, output, found, direction)
        missing = "".join(f"\n{sentence}" for sentence in found.failures)
        text = f"{sentence_of(found, direction)}; see {output}/{FILES[2]}{missing}"
        figures = summary_of_forces(found, direction)
        return Answer(text, {"folder": output, "files": FILES, **figures})
