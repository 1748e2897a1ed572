"""The reporter shows and files each iteration as it comes."""

import csv
import dataclasses
import io
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.files import guarded, replace_file
from toros_fem.base.keys import duration
from toros_fem.design.loop.options import Iteration
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.results.reporter import DesignReporter, ProgressBar, header, line, print_step
from toros_fem.results.runs.frames import FOLDER, Frame, read_frames, write_frame
from toros_fem.results.runs.open_run import open_run

EVALUATION: Any = SimpleNamespace(problem=None)  # of no shape, so that nothing is recorded


def row(metrics: dict[str, float]) -> Iteration:
    values: dict[str, Any] = {name: 0 for name in Iteration.__dataclass_fields__}
    values |= {"iteration": 7, "level": 2, "stage": 1, "objective": 1.5e-3, "pressure": 5e3}
    values |= {"g_r": 1e-5, "rejected": 2, "newton_steps": 31, "seconds": 1.25}
    return Iteration(**{**values, "metrics": metrics})


class Terminal(io.StringIO):
    """A stream that says to be a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    "metrics", [{}, {"angle_deg": 179.3}, {"angle_deg": -12.5, "a_very_long_name_percent": 100.0}]
)
def test_line_has_a_value_for_each_title(metrics: dict[str, float]) -> None:
    titles, values = header(row(metrics)), line(row(metrics))
    assert len(titles.split()) == len(values.split()) == 12 + len(metrics)
    found = dict(zip(titles.split(), values.split(), strict=True))
    assert found["it"] == "7"
    assert found["level"] == "2"
    assert found["stage"] == "1"
    assert found["kPa"] == "5.000"
    assert found["rejected"] == "2"
    assert found["newton"] == "31"
    for key, value in metrics.items():
        title = "/".join(key.rsplit("_", 1))
        assert float(found[title]) == pytest.approx(value, abs=0.005)
        # A value ends where its title ends.
        end = titles.index(title) + len(title)
        assert values[:end].split()[-1] == found[title]


def test_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    bar = ProgressBar()
    bar.advance(1)
    assert screen.getvalue() == "", "nothing is shown of an unknown number of steps"
    bar.expect(40)
    bar.advance(10)
    assert "10/40" in screen.getvalue()
    bar.expect(20)
    assert "10/20" in screen.getvalue()
    bar.advance(20)
    assert screen.getvalue().endswith("\r"), "the last step removes the bar"
    bar.close()


def test_lines_without_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Now and then, with the time left; steps before a run was resumed took no time."""
    stream, clock = io.StringIO(), iter((0.0, 20.0, 40.0, 50.0, 5000.0, 5010.0))
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr("toros_fem.results.reporter.time.monotonic", lambda: next(clock))
    bar = ProgressBar()
    bar.expect(40)
    for done in (10, 11, 12, 13, 20, 40):
        bar.advance(done)
    bar.close()
    assert stream.getvalue() == ""
    assert capsys.readouterr().out.splitlines() == [
        "step 12 of 40, about 9.3 min left",
        "step 20 of 40, about 2.8 h left",
    ]
    assert [duration(s) for s in (3.4, 59, 61, 7000)] == ["3 s", "59 s", "1.0 min", "1.9 h"]


def test_steps_of_the_first_rank_are_printed(
    comm: MPI.Comm, capsys: pytest.CaptureFixture[str]
) -> None:
    fields: dict[str, Any] = {name: 1 for name in NewtonStep.__dataclass_fields__}
    step = NewtonStep(**{**fields, "kind": "newton"})
    print_step(comm)(step)
    assert capsys.readouterr().out == (f"    {step}\n" if comm.rank == 0 else "")


NUMBERS: dict[str, Any] = {name: 1.0 for name in Iteration.__dataclass_fields__}
NUMBERS |= {
    "iteration": 0,
    "level": 0,
    "stage": 0,
    "rejected": 0,
    "newton_steps": 3,
    "seconds": 0.0,
}
ROW = Iteration(**{**NUMBERS, "metrics": {"a_mm": 2.0}})


def read(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_rows_are_on_disk_at_once(
    comm: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shared(comm, tmp_path) / "new"
    reporter = DesignReporter(comm, str(folder))
    assert folder.is_dir()
    for k in range(3):
        reporter(dataclasses.replace(ROW, iteration=k, objective=1 / 3), EVALUATION)
        rows = read(folder / "history.csv")
        comm.barrier()
        assert [row["iteration"] for row in rows] == [str(j) for j in range(k + 1)]
        assert list(rows[0]) == list(ROW.columns())
        names = [name for name in Iteration.__dataclass_fields__ if name != "metrics"]
        assert list(rows[0]) == [*names, "a_mm"]
        assert (rows[k]["a_mm"], float(rows[k]["objective"])) == ("2.0", 1 / 3), "all digits"
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == (4 if comm.rank == 0 else 0), "a header and three rows"


def test_an_earlier_history_stays_until_the_first_row(comm: MPI.Comm, tmp_path: Path) -> None:
    folder = shared(comm, tmp_path)
    path = folder / "history.csv"
    with open_run(comm, folder, {}):
        guarded(comm, folder, lambda: replace_file(path, b"of an earlier run\n"))
        reporter = DesignReporter(comm, folder)
    assert (folder / "history.csv").read_text(encoding="utf-8") == "of an earlier run\n"
    comm.barrier()
    reporter(ROW, EVALUATION)
    assert len(read(folder / "history.csv")) == 1


def test_clock_starts_with_the_reporter(comm: MPI.Comm, tmp_path: Path) -> None:
    """The set-up ends where the first iteration begins."""
    with DesignReporter(comm, shared(comm, tmp_path)) as reporter:
        reporter.expect(1)
        time.sleep(0.2)
        assert reporter.seconds["setup"] >= 0.2
        reporter(dataclasses.replace(ROW, seconds=0.15), EVALUATION)
        setup = reporter.seconds["setup"]
        assert 0.05 <= setup <= reporter.seconds["total"] - 0.15
        time.sleep(0.05)
        reporter(ROW, EVALUATION)
    assert reporter.seconds["setup"] == setup
    assert reporter.seconds["total"] >= 0.25


def test_the_shapes_of_the_kept_attempt_stay(comm: MPI.Comm, tmp_path: Path) -> None:
    """Attempt 2 takes the place of 1, and then of the first; iterations after 1 are not its own."""
    folder = shared(comm, tmp_path)
    reporter = DesignReporter(comm, folder)
    frames = folder / FOLDER

    def recorded(attempt: int) -> None:
        series = f"attempt-{attempt}" if attempt else "iteration"

        def write() -> None:
            frames.mkdir(exist_ok=True)
            for k in range(3):
                positions = np.full((1, 3), 10.0 * attempt + k)
                write_frame(frames, Frame(series, k, "skin", positions, None, {}))

        guarded(comm, folder, write)

    def kept() -> list[float]:
        shapes = [float(shape.positions[0, 0]) for shape in read_frames(frames, "iteration")]
        comm.barrier()
        return shapes

    recorded(0)
    recorded(reporter.begin())
    recorded(reporter.begin())
    reporter.keep(2, 2, 1)
    assert (kept(), reporter.attempt) == ([0.0, 1.0, 2.0], 1)
    for _ in range(2):  # a resumed run does it again
        reporter.keep(1, 1)
        assert (kept(), reporter.attempt) == ([20.0, 21.0], 0)
        assert len(list(frames.iterdir())) == 2
