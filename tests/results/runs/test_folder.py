"""A run's folder: its lock, files of earlier runs, what can be resumed and what cannot."""

import json
import logging
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.archive import Archive
from toros_fem.base.errors import CheckpointError, RunError, RunStoppedError
from toros_fem.results.runs.folder import open_run, read_record, run_of
from toros_fem.results.runs.lock import NAME, FolderLock

INPUTS = {"length": 0.1, "name": "tube"}


STATE = Archive("checkpoint", {"x": np.array([0.0, 1.0, 4.0])}, {"count": 1})


@pytest.fixture
def folder(comm: MPI.Comm, tmp_path: Path) -> Path:
    return shared(comm, tmp_path) / "run"


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def leave(comm: MPI.Comm, folder: Path, *, finished: bool) -> None:
    """Leave a run with a result and a state."""
    try:
        with open_run(comm, folder, INPUTS, scene="# mine\n") as run:
            run.journal(folder).entry(comm, "loop").offer(lambda: STATE, last=True)
            if comm.rank == 0:
                (folder / "summary.json").write_text("{}")
            comm.barrier()
            if not finished:
                raise RunStoppedError("stopped", 15)
    except RunStoppedError:
        assert not finished
    comm.barrier()


def test_a_run_is_recorded_and_found_by_its_folder(comm: MPI.Comm, folder: Path) -> None:
    assert run_of(folder) is None
    with open_run(comm, folder, INPUTS, scene="# mine\n") as run:
        assert run_of(folder) is run
        assert run_of(folder / "part") is run
        record, scene = read_record(comm, folder)
        assert record.inputs == INPUTS
        assert not record.finished
        assert scene == "# mine\n"
        comm.barrier()
    assert run_of(folder) is None
    assert read_record(comm, folder)[0].finished


def test_what_is_kept_is_found_again(
    comm: MPI.Comm, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """In the order of the loops, of parts of a run too."""
    leave(comm, folder, finished=False)
    with open_run(comm, folder, INPUTS, resume=True) as run:
        assert run.resumed
        journal = run.journal(folder)
        found = journal.entry(comm, "loop").saved()
        assert np.array_equal(found.arrays["x"], STATE.arrays["x"])
        assert not caplog.records, "the same version wrote it"
        assert journal.entry(comm, "next").saved() is None
        assert run.journal(folder / "part").entry(comm, "loop").saved() is None
        assert journal.branch("seed-1").entry(comm, "loop").saved() is None
    with pytest.raises(RunError, match="finished"):
        open_run(comm, folder, INPUTS, resume=True)


def test_a_lock_says_who_holds_it_now(tmp_path: Path) -> None:
    """Nothing is left of a holder with a longer name."""
    (tmp_path / NAME).write_text("process 1234567890 on " + 80 * "x")
    lock = FolderLock(tmp_path)
    with pytest.raises(RunError, match=rf"a run, process {os.getpid()} on [^x ]+\. Wait"):
        FolderLock(tmp_path)
    lock.release()


def test_other_inputs_or_loops_are_refused(comm: MPI.Comm, folder: Path) -> None:
    leave(comm, folder, finished=False)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(CheckpointError, match="other inputs"):
        open_run(comm, folder, {**INPUTS, "length": 0.2}, resume=True)
    with (
        pytest.raises(CheckpointError, match="with other problem"),
        open_run(comm, folder, INPUTS, resume=True) as run,
    ):
        run.journal(folder).entry(comm, "another loop").saved()
    comm.barrier()
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_files_of_earlier_runs_are_moved_aside(
    comm: MPI.Comm, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    if comm.rank == 0:
        folder.mkdir()
        (folder / "finger.stl").write_text("my own")
    comm.barrier()
    for count, finished in enumerate((True, False, True)):
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            leave(comm, folder, finished=finished)
        earlier = {f"earlier-{k}" for k in range(1, count + 1)}
        results = {"summary.json", "state", "scene.toml"}
        assert names(folder) - {".lock"} == {"finger.stl", *earlier, *results}
        if count:
            assert names(folder / f"earlier-{count}") == results
        if comm.rank == 0:
            assert len(caplog.messages) == (count > 0)
            assert ("not finished" in caplog.text) == (count == 2)
        comm.barrier()
    with open_run(comm, folder / "earlier-2", INPUTS, resume=True) as run:
        assert run.journal(run.folder).entry(comm, "loop").saved() is not None


def test_results_without_a_record_are_moved_but_not_other_files(
    comm: MPI.Comm, folder: Path
) -> None:
    results = {"history.csv", "shape.png", "report.html", "inflation.gif", "state/1.npz"}
    results |= {"frames/print-0.npz", "manufacture/cut_1.svg"}
    if comm.rank == 0:
        folder.mkdir()
        for name in (*results, "finger.stl", "mine.toml"):
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text("old")
    comm.barrier()
    with open_run(comm, folder, INPUTS):
        assert names(folder / "earlier-1") == {name.partition("/")[0] for name in results}
        assert names(folder) == {".lock", "earlier-1", "finger.stl", "mine.toml", "state"}
        comm.barrier()


def test_folders_that_cannot_be_used_are_told_at_the_start(comm: MPI.Comm, tmp_path: Path) -> None:
    taken = shared(comm, tmp_path) / "file"
    if comm.rank == 0:
        taken.write_text("mine")
    comm.barrier()
    for place in (taken, taken / "inside", Path("/proc/run")):
        with pytest.raises(RunError, match="cannot be used"):
            open_run(comm, place, INPUTS)
    assert taken.read_text() == "mine"
    with pytest.raises(RunError, match="holds no run"):
        open_run(comm, taken.parent, INPUTS, resume=True)
    with pytest.raises(RunError, match="holds no run"):
        read_record(comm, taken)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 99}, "has format 99; this version, .* reads format 3"),
        ({"format": 1}, "has format 1"),
        ({"format": "?"}, "damaged"),
        ({"surprise": 3}, "damaged"),
    ],
)
def test_damaged_and_newer_records_are_told(
    comm: MPI.Comm, folder: Path, change: dict[str, object], message: str
) -> None:
    leave(comm, folder, finished=False)
    if comm.rank == 0:
        record = folder / "state" / "run.json"
        text = record.read_text()
        changed = json.dumps({**json.loads(text), **change})
        record.write_text(changed)
    comm.barrier()
    for resume in (True, False):
        with pytest.raises(CheckpointError, match=message):
            open_run(comm, folder, INPUTS, resume=resume)
    assert (folder / "summary.json").exists(), "nothing was moved"


def test_every_kth_state_is_written(comm: MPI.Comm, folder: Path) -> None:
    made: list[int] = []

    def state(count: int) -> Archive:
        made.append(count)
        return STATE

    with open_run(comm, folder, INPUTS, every=3) as run:
        entry = run.journal(folder).entry(comm, "loop")
        for count in range(8):
            entry.offer(lambda count=count: state(count), last=count == 7)  # type: ignore[misc]
    assert made == [0, 3, 6, 7]


def test_signals_ask_for_a_write_or_an_end(comm: MPI.Comm, folder: Path) -> None:
    """One rank's signal is all ranks'; handlers are restored."""
    before = [signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGUSR1)]
    rows: list[int] = []

    def offer(entry: Any, count: int, asked: signal.Signals | None = None) -> None:
        if asked is not None and comm.rank == comm.size - 1:
            os.kill(os.getpid(), asked)

        def state() -> Archive:
            rows.append(count)
            return STATE

        entry.offer(state, last=False)

    with (  # noqa: PT012
        pytest.raises(RunStoppedError, match=r"stopped by SIGTERM; .*go on by this") as stop,
        open_run(comm, folder, INPUTS, every=9, again="go on by this") as run,
    ):
        entry = run.journal(folder).entry(comm, "loop")
        offer(entry, 0)
        offer(entry, 1)
        offer(entry, 2, signal.SIGUSR1)
        offer(entry, 3)
        offer(entry, 4, signal.SIGTERM)
    assert rows == [0, 2, 4]
    assert stop.value.signal == signal.SIGTERM
    assert [signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGUSR1)] == before


def test_where_nothing_is_to_be_written_a_run_stops_at_once(
    alone: MPI.Comm, tmp_path: Path
) -> None:
    """Outside of loops, and in them at a second signal."""
    folder = tmp_path / "run"
    with pytest.raises(RunStoppedError, match="SIGINT"), open_run(alone, folder, INPUTS):  # noqa: PT012
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except RunStoppedError:  # as PETSc does with errors in callbacks
            raise RuntimeError("error code -1") from None
    with open_run(alone, folder, INPUTS, resume=True) as run:
        entry = run.journal(folder).entry(alone, "loop")
        entry.offer(lambda: STATE, last=False)
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(RunStoppedError):
            os.kill(os.getpid(), signal.SIGINT)
