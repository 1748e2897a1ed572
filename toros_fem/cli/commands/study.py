"""`toros study`: one scene with many values, in one table."""

from __future__ import annotations

from dataclasses import MISSING
from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.keys import File, Flag, Text, key
from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.exit_codes import DONE, NO_EQUILIBRIUM
from toros_fem.cli.command_line.scene_options import SceneCommand


class Study(SceneCommand, kw_only=True):
    """Runs a scene with all combinations of some values, and tabulates the results.

    Each run has its own folder in that of the study. study.csv has a row for each run, with its
    values and all results; study.png draws them. The same command continues a study that was
    stopped: finished runs are kept, stopped ones continue, and you may give more values.
    """

    over: tuple[Text, ...] = key(
        MISSING,
        "values of a key: a list with commas, LOW..HIGH:COUNT for even steps, LOW..HIGH for whole "
        "numbers; may be given several times",
    )
    output: File = key(MISSING, "folder of the study, made if missing")
    simulate: Flag = key(False, "simulate each scene, and design nothing")

    TAKES: ClassVar = {**SceneCommand.TAKES, "over": "KEY=VALUES", "output": "STUDY"}
    EXAMPLES: ClassVar = (
        "toros study mine.toml --over pressure=2..10kPa:5 --over seed=1..4 --output study",
        "toros study mine.toml --over fabric=jersey-light,stockinette-course --coarse --output s",
        "mpirun -n 2 toros study mine.toml --over seed=1..4 --output study",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Run all of them, one after the other (collective)."""
        from toros_fem.cli.studies.study import TABLE, run_study

        command = "simulate" if self.simulate else "design"
        with self.meshes_allowed():
            rows = run_study(
                comm,
                self.file,
                self.over,
                self.output,
                command=command,
                coarse=self.coarse,
                changes=self.set,
            )
        failed = sum(bool(row["failure"]) for row in rows)
        text = f"{self.output / TABLE}: {len(rows)} runs"
        if failed:
            text += f", {failed} of them without a result (see the column failure)"
        code = NO_EQUILIBRIUM if failed else DONE
        return Answer(text, {"table": self.output / TABLE, "rows": rows}, code)
