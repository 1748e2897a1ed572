"""A run's folder: its lock, files of earlier runs, what can be resumed and what cannot."""

import json
import logging
import os
import signal
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.archive import Archive
from toros_fem.base.errors import (
    CheckpointError,
    FileError,
    OutputError,
    ParameterError,
    RunStoppedError,
)
from toros_fem.base.files import (
    LISTED,
    UNFINISHED,
    guarded,
    if_possible,
    listed,
    listing,
    replace_file,
    write_json,
)
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.runs.folder import FREE, open_run, read_record, run_of
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
            guarded(comm, folder, lambda: write_json(folder / "summary.json", {}))
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
        journal = run.journal(folder)
        found = journal.entry(comm, "loop").saved()
        assert np.array_equal(found.arrays["x"], STATE.arrays["x"])
        assert not caplog.records, "the same version wrote it"
        assert journal.entry(comm, "next").saved() is None
        assert run.journal(folder / "part").entry(comm, "loop").saved() is None
        assert journal.branch("seed-1").entry(comm, "loop").saved() is None
    with pytest.raises(OutputError, match="finished"):
        open_run(comm, folder, INPUTS, resume=True)


def test_a_lock_says_who_holds_it_now(tmp_path: Path) -> None:
    """Nothing is left of a holder with a longer name."""
    (tmp_path / NAME).write_text("process 1234567890 on " + 80 * "x")
    lock = FolderLock(tmp_path)
    with pytest.raises(OutputError, match=rf"a run, process {os.getpid()} on [^x ]+\. Wait"):
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


def test_inputs_that_may_change(comm: MPI.Comm, folder: Path) -> None:
    """A run goes on with others; an error before it writes leaves the record as it was."""

    def run(steps: int, loop: str, *, resume: bool = True) -> bool:
        """Run through an entry, and write it if it is missing; return whether it was there."""
        inputs = {**INPUTS, FREE: steps}
        with open_run(comm, folder, inputs, scene=f"# {steps}\n", resume=resume) as opened:
            entry = opened.journal(folder).branch("part").entry(comm, loop)
            there = entry.saved() is not None
            if loop == "faulty":
                raise ParameterError("wrong")
            if not there:
                entry.offer(lambda: STATE, last=True)
        return there

    def recorded() -> tuple[Any, str | None]:
        record, scene = read_record(comm, folder)
        return (record.inputs[FREE], record.finished, record.changed), scene

    assert not run(1, "loop", resume=False)
    assert run(2, "loop")
    assert recorded() == ((2, True, False), "# 2\n")
    with pytest.raises(ParameterError):
        run(3, "faulty")
    assert recorded() == ((2, True, False), "# 2\n")
    with pytest.raises(OutputError, match="is finished"):
        run(2, "loop")
    assert not run(3, "another loop"), "it is made anew"


def test_branches_are_found_again(comm: MPI.Comm, folder: Path) -> None:
    with open_run(comm, folder, INPUTS) as run:
        journal = run.journal(folder)
        assert journal.branch("polish") is journal.branch("polish")


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
        assert names(folder) - {NAME, LISTED} == {"finger.stl", *earlier, *results}
        if count:
            assert names(folder / f"earlier-{count}") == {*results, LISTED}
        if comm.rank == 0:
            assert len(caplog.messages) == (count > 0)
            assert ("not finished" in caplog.text) == (count == 2)
        comm.barrier()
    with open_run(comm, folder / "earlier-2", INPUTS, resume=True) as run:
        assert run.journal(run.folder).entry(comm, "loop").saved() is not None


def test_a_run_inside_another_folder_of_ours_has_its_own_list(comm: MPI.Comm, folder: Path) -> None:
    """A study keeps its runs in folders of its own; each of them can be run again."""
    inside = folder / "one"
    guarded(comm, folder, lambda: replace_file(folder / "study.csv", b"a\n"))
    leave(comm, inside, finished=True)
    leave(comm, inside, finished=True)
    assert {"earlier-1", "scene.toml", "summary.json"} <= names(inside)
    assert "one" not in (folder / LISTED).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["scene.toml", "summary.json", "frames", "state/1.npz"])
def test_files_that_no_run_listed_are_never_replaced(
    comm: MPI.Comm, folder: Path, name: str
) -> None:
    """With the name of a file of runs they bar the folder, before anything is done to it."""
    path = folder / name
    if comm.rank == 0:
        path.parent.mkdir(parents=True)
        path.write_text("mine")
    comm.barrier()
    with pytest.raises(OutputError, match=f"has {name.partition('/')[0]}, which no run listed"):
        open_run(comm, folder, INPUTS, scene="# mine\n")
    assert names(folder) - {NAME} == {name.partition("/")[0]}
    assert path.read_text() == "mine"


def test_files_beside_those_of_a_run_stay(comm: MPI.Comm, folder: Path) -> None:
    """Also inside its folders, and those that came while it ran."""
    mine = {"print_9.stl", "cut_7.svg", "frames/my.txt", "manufacture/print_9.stl", "notes"}
    for count in range(2):
        with open_run(comm, folder, INPUTS):
            if comm.rank == 0:
                for name in mine:
                    (folder / name).parent.mkdir(exist_ok=True)
                    (folder / name).write_text("mine")
            for name in ("frames/print-0.npz", "manufacture/print_1.stl"):
                replace = partial(replace_file, folder / name, b"ours")
                guarded(comm, folder, replace)
        earlier = folder / "earlier-1"
        assert earlier.exists() == (count > 0)
        for name in mine:
            assert (folder / name).read_text() == "mine"
    found = {path.relative_to(earlier).as_posix() for path in earlier.rglob("*") if path.is_file()}
    assert found - {LISTED, "state/run.json"} == {"frames/print-0.npz", "manufacture/print_1.stl"}
    comm.barrier()
    with (
        pytest.raises(OutputError, match=r"notes is there, and \.toros_files does not list it"),
        open_run(comm, folder, INPUTS),
    ):
        guarded(comm, folder, lambda: replace_file(folder / "notes", b"ours"))
    comm.barrier()
    assert (folder / "notes").read_text() == "mine"
    assert not (folder / "earlier-2").exists()
    assert read_record(comm, folder)[0].finished, "the earlier run is back"


def test_a_run_that_ends_before_it_writes_leaves_the_earlier_one(
    comm: MPI.Comm, folder: Path
) -> None:
    leave(comm, folder, finished=True)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    comm.barrier()
    with pytest.raises(ParameterError), open_run(comm, folder, {"length": 0.2}, scene="# new\n"):  # noqa: PT012
        assert names(folder / "earlier-1") == {"summary.json", "state", "scene.toml", LISTED}
        comm.barrier()
        raise ParameterError("wrong")
    comm.barrier()
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    comm.barrier()
    with pytest.raises(ParameterError), open_run(comm, folder, {"length": 0.2}) as run:  # noqa: PT012
        run.journal(folder).entry(comm, "loop").offer(lambda: STATE, last=False)
        raise ParameterError("later")
    comm.barrier()
    assert (folder / "earlier-1" / "summary.json").exists()
    assert not read_record(comm, folder)[0].finished, "it can go on"


def test_a_folder_that_was_moved_in_part_is_moved_again(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    leave(alone, folder, finished=True)
    rename, count = Path.rename, [0]

    def once(one: Path, other: Path) -> Path:
        count[0] += 1
        if count[0] == 2:
            raise OSError("gone")
        return rename(one, other)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", once)
        with pytest.raises(OutputError, match="gone"):
            open_run(alone, folder, INPUTS)
    with open_run(alone, folder, INPUTS):
        pass
    found = {path.name for path in folder.rglob("*") if path.is_file()}
    assert {"summary.json", "scene.toml"} <= found


LINKS = [NAME, LISTED, "summary.json", "state", "scene.toml"]


@pytest.mark.parametrize("name", LINKS)
def test_nothing_is_written_through_a_link(comm: MPI.Comm, folder: Path, name: str) -> None:
    other = folder.parent / "other"
    if comm.rank == 0:
        folder.mkdir()
        other.write_text("mine")
        (folder / name).symlink_to(other)
    comm.barrier()
    words = "cannot be used|no lock|no run listed|is no plain file"
    with pytest.raises(OutputError, match=words):
        open_run(comm, folder, INPUTS, scene="# mine\n")
    assert other.read_text() == "mine"
    comm.barrier()
    if comm.rank == 0:
        (folder / name).unlink()
    comm.barrier()
    leave(comm, folder, finished=True)
    if comm.rank == 0:
        (folder / "summary.json").unlink()
        (folder / "summary.json").symlink_to(other)
        (folder / "summary.json.unfinished").symlink_to(other)
    guarded(comm, folder, lambda: write_json(folder / "summary.json", {}))
    assert other.read_text() == "mine"
    assert not (folder / "summary.json").is_symlink()


@pytest.mark.parametrize("kind", ["hard link", "file", "pipe", "folder"])
def test_a_lock_of_somebody_else_is_left_alone(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "run"
    path, other = folder / NAME, folder / "other"
    folder.mkdir()
    other.write_text("mine")
    {
        "hard link": lambda: path.hardlink_to(other),
        "file": lambda: path.write_text("mine"),
        "pipe": lambda: os.mkfifo(path),
        "folder": path.mkdir,
    }[kind]()
    with pytest.raises(OutputError, match="is no lock of a run. Move it"):
        FolderLock(folder)
    assert other.read_text() == "mine"
    assert kind != "file" or path.read_text() == "mine"


def test_no_device_and_no_folder_is_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "pipe", tmp_path / "folder", Path(os.devnull)):
        with pytest.raises(OSError, match="no regular file"):
            replace_file(path, b"")
    assert names(tmp_path) == {"pipe", "folder"}
    assert Path(os.devnull).is_char_device()


def test_folders_that_cannot_be_used_are_told_at_the_start(comm: MPI.Comm, tmp_path: Path) -> None:
    taken = shared(comm, tmp_path) / "file"
    if comm.rank == 0:
        taken.write_text("mine")
    comm.barrier()
    for place in (taken, taken / "inside", Path("/proc/run")):
        with pytest.raises(OutputError, match="cannot be used"):
            open_run(comm, place, INPUTS)
    assert taken.read_text() == "mine"
    with pytest.raises(FileError, match="holds no run"):
        open_run(comm, taken.parent, INPUTS, resume=True)
    with pytest.raises(FileError, match="holds no run"):
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
    with (  # noqa: PT012
        pytest.raises(RunStoppedError, match="SIGINT"),
        open_run(alone, folder, INPUTS, resume=True) as run,
    ):
        entry = run.journal(folder).entry(alone, "loop")
        entry.offer(lambda: STATE, last=False)
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(RunStoppedError):
            os.kill(os.getpid(), signal.SIGINT)
    assert not read_record(alone, folder)[0].finished, "a stop that was swallowed is none that ends"


@pytest.mark.parametrize("swallow", [if_possible, None], ids=["if_possible", "anything"])
def test_a_stop_is_no_error_that_is_passed_over(
    alone: MPI.Comm, tmp_path: Path, swallow: Any
) -> None:
    """Machine files are written at the end: a stop there leaves a run that is not finished."""
    folder = tmp_path / "run"

    def write() -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        (folder / "print_1.stl").write_text("late")

    with (  # noqa: PT012
        pytest.raises(RunStoppedError, match="SIGTERM"),
        open_run(alone, folder, INPUTS),
    ):
        try:
            if swallow is None:
                write()
            else:
                guarded(alone, folder, lambda: swallow("machine files", write))
        except Exception:
            pytest.fail("a stop is no Exception")
    assert not (folder / "print_1.stl").exists()
    with open_run(alone, folder, INPUTS, resume=True):
        pass


def test_a_stop_that_another_error_hides_is_a_stop(alone: MPI.Comm, tmp_path: Path) -> None:
    """The new run stays, and is the one that goes on: not the earlier one."""
    folder = tmp_path / "run"
    with open_run(alone, folder, {"a": 1}):
        pass
    with pytest.raises(RunStoppedError, match="SIGTERM"), open_run(alone, folder, {"a": 2}):  # noqa: PT012
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        except BaseException as error:
            raise ValueError from error
    with open_run(alone, folder, {"a": 2}, resume=True):
        pass


def test_a_list_names_files_of_its_folder_alone(alone: MPI.Comm, tmp_path: Path) -> None:
    victim, folder = tmp_path / "victim.txt", tmp_path / "run"
    folder.mkdir()
    victim.write_text("mine")
    (folder / LISTED).write_text(f"../victim.txt\n{victim}\n")
    with open_run(alone, folder, INPUTS):
        pass
    assert victim.read_text() == "mine"
    assert listed(folder).keys() & {"../victim.txt", str(victim)} == set()


@pytest.mark.parametrize("kind", ["pipe", "link", "endless", "long"])
def test_a_list_that_is_no_plain_file_is_refused(
    alone: MPI.Comm, tmp_path: Path, kind: str
) -> None:
    path = tmp_path / LISTED
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "long":
        path.write_text("x" * 1_000_001)
    else:
        path.symlink_to("/dev/zero" if kind == "endless" else tmp_path / "other")
    with pytest.raises(OutputError, match="is no plain file, or too large"):
        open_run(alone, tmp_path, INPUTS)


def test_nothing_is_written_through_a_linked_folder(alone: MPI.Comm, tmp_path: Path) -> None:
    folder, outside = tmp_path / "run", tmp_path / "outside"
    folder.mkdir()
    outside.mkdir()
    (folder / "frames").symlink_to(outside)
    with pytest.raises(OutputError, match="has frames, which no run listed"):
        open_run(alone, folder, INPUTS)
    (folder / LISTED).write_text("manufacture\n")
    (folder / "manufacture").symlink_to(outside)
    with listing(folder), pytest.raises(OutputError, match="is a link, through which print_1.stl"):
        replace_file(folder / "manufacture" / "print_1.stl", b"x")
    assert not any(outside.iterdir())


def test_a_finished_run_is_no_folder_for_other_results(comm: MPI.Comm, folder: Path) -> None:
    """A script that writes there moves it aside, or is refused before it has written anything."""
    leave(comm, folder, finished=True)
    with pytest.raises(OutputError, match="holds a run, whose files would be replaced"):
        DesignReporter(comm, folder)
    with open_run(comm, folder, INPUTS):
        DesignReporter(comm, folder)


def test_what_a_killed_process_was_writing_goes(alone: MPI.Comm, tmp_path: Path) -> None:
    left = [tmp_path / f".1{UNFINISHED}", tmp_path / "frames" / f".2{UNFINISHED}"]
    left[1].parent.mkdir()
    for resume in (False, True):
        for path in left:
            path.write_text("half")
        with (  # noqa: PT012
            pytest.raises(RunStoppedError),
            open_run(alone, tmp_path, INPUTS, resume=resume) as run,
        ):
            assert not any(path.exists() for path in left)
            run.stop(signal.SIGTERM)
