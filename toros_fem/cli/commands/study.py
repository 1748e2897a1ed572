"""`toros study`: one scene with many values, in one table."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import ClassVar

from mpi4py import MPI

from toros_fem.base.keys import Count, key
from toros_fem.cli.command_line.command import Answer
from toros_fem.cli.command_line.exit_codes import DONE, NO_EQUILIBRIUM
from toros_fem.cli.command_line.parser import UsageError
from toros_fem.cli.command_line.scene_options import SceneCommand


@dataclass(frozen=True, kw_only=True)
class Study(SceneCommand):
    """Runs a scene with all combinations of some values, and tabulates the results.

    Each run has its own folder in that of the study. study.csv has a row for each run, with its
    values and all results; study.png draws them. The same command continues a study that was
    stopped: finished runs are kept, stopped ones continue, and you may give more values.
    """

    over: tuple[str, ...] = key(
        MISSING,
        "values of a key: a list with commas, LOW..HIGH:COUNT for even steps, LOW..HIGH for whole "
        "numbers; may be given several times",
    )
    output: Path = key(MISSING, "folder of the study, made if missing")
    simulate: bool = key(False, "simulate each scene, and design nothing")
    jobs: Count | None = key(None, "runs at a time; none takes one for each core")

    TAKES: ClassVar = {**SceneCommand.TAKES, "over": "KEY=VALUES", "output": "STUDY"}
    EXAMPLES: ClassVar = (
        "toros study mine.toml --over pressure=2..10kPa:5 --over seed=1..4 --output study",
        "toros study mine.toml --over fabric=jersey-light,stockinette-course --coarse --output s",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Run all of them, in processes of their own."""
        from toros_fem.cli.studies.study import run_study

        if comm.size > 1:
            raise UsageError("a study runs its scenes side by side by itself: leave out mpirun.")
        found = run_study(
            self.file,
            self.over,
            self.output,
            command="simulate" if self.simulate else "design",
            coarse=self.coarse,
            changes=self.set,
            allow_large=self.allow_large,
            jobs=self.jobs,
        )
        failed = len(found.failed)
        text = f"{found.table}: {len(found.trials)} runs"
        if failed:
            text += f", {failed} of them without a result (see the column failure, and logs/)"
        code = NO_EQUILIBRIUM if failed else DONE
        return Answer(text, {"table": found.table, "rows": found.rows}, code)
