"""A whole design, stopped anywhere, goes on to the same files, through levels and corrections."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from helpers.designs import DESIGN_ALONE, TWO_LEVELS
from helpers.run_files import content
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.errors import CheckpointError, OutputError, RunStoppedError
from toros_fem.design.loop.options import Iteration
from toros_fem.products import tubes
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.runs.open_run import FREE, open_run

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("without_pictures")]


def design(comm: MPI.Comm, folder: Path, config: Any, stop_at: int | None = None) -> int:
    """Design, stopped by a signal to the last rank after some rows; return the number of rows."""
    rows = 0

    class Counted(DesignReporter):
        def report(self, row: Iteration) -> None:
            nonlocal rows
            rows += 1
            super().report(row)
            if rows == stop_at and comm.rank == comm.size - 1:
                os.kill(os.getpid(), signal.SIGTERM)

    resume = (folder / "state").exists()
    comm.barrier()
    values, free = config.fixed_and_free()
    with open_run(comm, folder, {**values, FREE: free}, resume=resume):
        config.run_design(comm, folder, reporter=Counted(comm, folder))
    return rows


def check(comm: MPI.Comm, folder: Path, config: Any, *stops: int) -> None:
    """Stop a run after so many rows each time, and compare its end with an uninterrupted run."""
    total = design(comm, folder / "whole", config)
    done = 0
    for rows in stops:
        with pytest.raises(RunStoppedError, match=f"SIGTERM.*toros resume {folder / 'stopped'}"):
            design(comm, folder / "stopped", config, rows)
        done += rows
        assert not (folder / "stopped" / "pattern.svg").exists()
    left = design(comm, folder / "stopped", config)
    assert left == total - done, "a signal loses no step"
    assert content(folder / "stopped") == content(folder / "whole")
    if comm.rank == 0:
        last = (json.loads((folder / name / "state" / "run.json").read_text())["finished"]
                for name in ("whole", "stopped"))  # fmt: skip
        assert all(last)
    comm.barrier()


def test_densities_through_levels_polish_and_corrections(comm: MPI.Comm, tmp_path: Path) -> None:
    check(comm, shared(comm, tmp_path), TWO_LEVELS.updated(hold_pressure=True), 1, 5)


def test_a_designed_pressure(comm: MPI.Comm, tmp_path: Path) -> None:
    """A correction goes on with the same pressure but for rounding: 4e-12 of a figure was seen."""
    folder = shared(comm, tmp_path)
    design(comm, folder / "whole", TWO_LEVELS)
    for stop in (1, 5):
        with pytest.raises(RunStoppedError):
            design(comm, folder / "stopped", TWO_LEVELS, stop)
    design(comm, folder / "stopped", TWO_LEVELS)
    found, expected = (
        [float(value) for row in content(folder / name)[0] for value in row.values()]
        for name in ("stopped", "whole")
    )
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-15)


def test_a_finished_run_goes_further(comm: MPI.Comm, tmp_path: Path) -> None:
    """By a step on the coarse mesh and a correction; it ends as a run that is to go so far at once.

    They differ by rounding: the shorter one has simulated its print before it goes on.
    """
    folder, longer = shared(comm, tmp_path), TWO_LEVELS.updated(constrained_iterations=2)
    shorter = longer.updated(constrained_iterations=1, corrections=0)
    design(comm, folder / "whole", longer)
    design(comm, folder / "further", shorter)
    with pytest.raises(OutputError, match="is finished"):
        design(comm, folder / "further", shorter)
    assert design(comm, folder / "further", longer) >= 3
    (rows, summary, _), (all_rows, all_of_it, _) = (
        content(folder / name) for name in ("further", "whole")
    )
    assert len(rows) == len(all_rows)
    found = [float(value) for row in rows for value in row.values()]
    expected = [float(value) for row in all_rows for value in row.values()]
    found += [figure["value"] for figure in summary["figures"]]
    expected += [figure["value"] for figure in all_of_it["figures"]]
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-12)
    with pytest.raises(CheckpointError, match="other inputs"):
        design(comm, folder / "further", longer.updated(angle=31.0))


def test_steps_of_a_stage_that_is_over(comm: MPI.Comm, tmp_path: Path) -> None:
    """They change nothing, and are refused; without the next stage it is another loop."""
    folder = shared(comm, tmp_path)
    config = TWO_LEVELS.updated(levels=1, corrections=0, polish_iterations=0)
    design(comm, folder, config)
    with pytest.raises(CheckpointError, match="1 steps is over, .* 5 steps change nothing"):
        design(comm, folder, config.updated(iterations=5))
    with pytest.raises(OutputError, match="is finished"):
        design(comm, folder, config)
    changed = config.updated(iterations=2, constrained_iterations=0)
    assert design(comm, folder, changed) == 3, "one stage, from its start"
    assert design(comm, folder, changed.updated(iterations=3)) == 1


def test_several_starts(comm: MPI.Comm, tmp_path: Path) -> None:
    """Each rank alone keeps the states of its seeds."""
    folder = shared(comm, tmp_path)
    config = TWO_LEVELS.updated(starts=2, corrections=0, polish_iterations=0)
    total = design(comm, folder / "whole", config)
    with pytest.raises(RunStoppedError):
        design(comm, folder / "stopped", config, total - 1)
    kept = {p.name for p in (folder / "stopped" / "state").iterdir()}
    assert {f"seed-{config.design.seed + k}.000.npz" for k in range(2)} | {"000.npz"} <= kept
    comm.barrier()
    design(comm, folder / "stopped", config)
    assert content(folder / "stopped")[1:] == content(folder / "whole")[1:]


def test_lines_from_a_random_start(alone: MPI.Comm, tmp_path: Path) -> None:
    """Inside a stage of the relaxed design, and after a print, which is not simulated again."""
    config = tubes.TwistScene.of(
        start="relaxed",
        length=0.06,
        relaxed_edge_length=8e-3,
        relaxed_iterations=2,
        directions=4,
        print_edge_length=4e-3,
        laid_width=4e-3,
        corrections=0,
        density_iterations=1,
        cross_sections=4,
        twist=60.0,
        pressure=8e3,
        **DESIGN_ALONE,
    )
    check(alone, tmp_path, config, 3, 4)
