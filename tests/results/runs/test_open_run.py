"""A run's folder: its lock, what is overwritten and what stays, what can be resumed or cannot."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.scenes import shared, square
from mpi4py import MPI

from toros_fem.base.errors import (
    CheckpointError,
    FileError,
    OutputError,
    ParameterError,
    RunStoppedError,
)
from toros_fem.base.files import UNFINISHED, Archive, guarded, if_possible, replace_file, write_json
from toros_fem.making.machine_files import write_manufacture
from toros_fem.making.manifest import FORMAT, NAME
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.runs.open_run import (
    FREE,
    FolderLock,
    open_run,
    read_record,
    require_open,
    run_of,
)
from toros_fem.results.runs.open_run import NAME as LOCK

INPUTS = {"length": 0.1, "name": "tube"}
SQUARE = square()


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


def plant(folder: Path, outside: Path) -> dict[Path, bytes | Path]:
    """Put files and links of a person among those of a run; return what each is."""
    outside.mkdir(exist_ok=True)
    (outside / "print-000000.npz").write_text("mine")
    for name in ("notes.txt", "frames/my.npz", "manufacture/cut_7.svg", "state/my.txt", "own/a"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine")
    (folder / "link").symlink_to(outside)
    (folder / "frames" / "link").symlink_to(outside)
    return {path: path.readlink() if path.is_symlink() else path.read_bytes()
            for path in (*folder.rglob("*"), *outside.rglob("*"))
            if path.is_symlink() or (path.is_file() and path.read_bytes() == b"mine")}  # fmt: skip


def stays(planted: dict[Path, bytes | Path]) -> None:
    for path, content in planted.items():
        assert (path.readlink() if path.is_symlink() else path.read_bytes()) == content, path


def test_a_folder_that_is_not_empty_is_refused(comm: MPI.Comm, folder: Path) -> None:
    """Also to be overwritten, where it holds no run; nothing is written there."""
    if comm.rank == 0:
        folder.mkdir()
        (folder / "finger.stl").write_text("my own")
    comm.barrier()
    for overwrite, words in ((False, "is not empty"), (True, "holds no run that could be over")):
        with pytest.raises(OutputError, match=words):
            open_run(comm, folder, INPUTS, overwrite=overwrite)
        with pytest.raises(OutputError, match=words):
            DesignReporter(comm, folder, overwrite=overwrite)
    assert names(folder) == {"finger.stl"}


def test_a_run_that_is_refused_at_once_leaves_its_folder_empty(
    comm: MPI.Comm, folder: Path
) -> None:
    """So that it is begun again with other inputs; what has written anything stays."""
    with pytest.raises(ParameterError), open_run(comm, folder, INPUTS, scene="# mine\n"):
        raise ParameterError("wrong")
    comm.barrier()
    assert names(folder) == {LOCK}
    comm.barrier()
    with pytest.raises(ParameterError), open_run(comm, folder, {"length": 0.2}) as run:  # noqa: PT012
        run.journal(folder).entry(comm, "loop").offer(lambda: STATE, last=False)
        raise ParameterError("later")
    comm.barrier()
    assert not read_record(comm, folder)[0].finished, "it can go on"


def test_a_run_is_overwritten_by_its_names_alone(comm: MPI.Comm, folder: Path) -> None:
    """What a person put beside its files and into its folders stays, links unfollowed."""
    leave(comm, folder, finished=True)
    outside, planted = folder.parent / "outside", {}
    if comm.rank == 0:
        planted = plant(folder, outside)
        for name in ("frames/print-000000.npz", "state/seed-1.000.npz", "curve.csv"):
            (folder / name).write_text("of the run")
        (folder / "shape.png").symlink_to(outside / "print-000000.npz")
    comm.barrier()
    with pytest.raises(OutputError, match="is not empty.* by --overwrite; nothing was done"):
        open_run(comm, folder, INPUTS)
    with open_run(comm, folder, {"length": 0.2}, scene="# new\n", overwrite=True):
        stays(planted)
        there = {path.relative_to(folder).as_posix() for path in folder.rglob("*")}
        gone = {"frames/print-000000.npz", "state/seed-1.000.npz", "curve.csv", "shape.png"}
        assert not there & {*gone, "summary.json", "state/000.npz"}
        comm.barrier()
    assert read_record(comm, folder)[0].inputs == {"length": 0.2}
    assert (folder / "scene.toml").read_text() == "# new\n"
    stays(planted)


def test_machine_files_are_removed_as_they_were_made(alone: MPI.Comm, tmp_path: Path) -> None:
    """One that was changed bars the folder, before anything is removed."""
    leave(alone, tmp_path, finished=True)
    place = tmp_path / "manufacture"
    write_manufacture(place, SQUARE, [shapely.box(0.005, 0.005, 0.01, 0.01)])
    (place / "cut_1.svg").write_text("mine")
    with pytest.raises(FileError, match=r"has cut_1\.svg, .* which changed since"):
        open_run(alone, tmp_path, INPUTS, overwrite=True)
    assert (tmp_path / "summary.json").exists()
    (place / "cut_1.svg").rename(place / "mine.svg")
    with open_run(alone, tmp_path, INPUTS, overwrite=True):
        assert names(place) == {"mine.svg"}


def test_a_hostile_manifest_removes_nothing_elsewhere(alone: MPI.Comm, tmp_path: Path) -> None:
    folder, victim = tmp_path / "run", tmp_path / "victim.txt"
    leave(alone, folder, finished=True)
    victim.write_text("mine")
    (folder / "manufacture").mkdir()
    names = ["../../victim.txt", str(victim)]
    content = {"format": FORMAT, "others": names, "files": [{"name": one} for one in names]}
    write_json(folder / "manufacture" / NAME, content)
    with open_run(alone, folder, INPUTS, overwrite=True):
        assert victim.read_text() == "mine"


def test_a_folder_that_was_removed_in_part_is_overwritten_again(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave(alone, tmp_path, finished=True)
    unlink, count = Path.unlink, [0]

    def once(path: Path, missing_ok: bool = False) -> None:
        count[0] += 1
        if count[0] == 2:
            raise OSError("gone")
        unlink(path, missing_ok)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", once)
        with pytest.raises(OutputError, match="gone"):
            open_run(alone, tmp_path, INPUTS, overwrite=True)
    with open_run(alone, tmp_path, INPUTS, overwrite=True):
        assert names(tmp_path) == {LOCK, "state"}


@pytest.mark.parametrize("name", ["state", "frames", "manufacture"])
def test_nothing_is_written_through_a_linked_folder(
    alone: MPI.Comm, tmp_path: Path, name: str
) -> None:
    folder, outside = tmp_path / "run", tmp_path / "outside"
    leave(alone, folder, finished=False)
    if name == "state":
        (folder / name).rename(outside)
    else:
        outside.mkdir()
    (folder / name).symlink_to(outside)
    before = names(outside)
    ways: list[dict[str, Any]] = [{"resume": True}, {"overwrite": True}]
    for how in ways:
        with pytest.raises(OutputError, match=f"{name} is a link, through which"):
            open_run(alone, folder, INPUTS, **how)
    assert names(outside) == before
    assert (folder / "summary.json").exists()


def test_no_file_is_written_through_a_link(comm: MPI.Comm, folder: Path) -> None:
    """The link's name is taken; what it points at stays."""
    other = folder.parent / "other"
    leave(comm, folder, finished=True)
    if comm.rank == 0:
        other.write_text("mine")
        for name in ("summary.json", "summary.json.unfinished"):
            (folder / name).unlink(missing_ok=True)
            (folder / name).symlink_to(other)
    guarded(comm, folder, lambda: write_json(folder / "summary.json", {}))
    assert other.read_text() == "mine"
    assert not (folder / "summary.json").is_symlink()


@pytest.mark.parametrize("kind", ["link", "hard link", "file", "pipe", "folder"])
def test_a_lock_of_somebody_else_is_left_alone(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "run"
    path, other = folder / LOCK, folder / "other"
    folder.mkdir()
    other.write_text("mine")
    {
        "link": lambda: path.symlink_to(other),
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
    ways: list[dict[str, Any]] = [{"resume": True}, {"overwrite": True}]
    for how in ways:
        with pytest.raises(CheckpointError, match=message):
            open_run(comm, folder, INPUTS, **how)
    assert (folder / "summary.json").exists(), "nothing was removed"


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
    with (  # noqa: PT012
        pytest.raises(RunStoppedError, match="SIGTERM"),
        open_run(alone, folder, {"a": 2}, overwrite=True),
    ):
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        except BaseException as error:
            raise ValueError from error
    with open_run(alone, folder, {"a": 2}, resume=True):
        pass


def test_a_finished_run_is_no_folder_for_other_results(comm: MPI.Comm, folder: Path) -> None:
    """A script that writes there overwrites it, or is refused before it has written anything."""
    leave(comm, folder, finished=True)
    with pytest.raises(OutputError, match="is not empty"):
        DesignReporter(comm, folder)
    with pytest.raises(OutputError, match="holds a run, whose files would be replaced"):
        guarded(comm, folder, lambda: require_open(folder))
    with open_run(comm, folder, INPUTS, overwrite=True):
        DesignReporter(comm, folder)
    DesignReporter(comm, folder, overwrite=True)
    guarded(comm, folder, lambda: require_open(folder))


def test_what_a_killed_process_was_writing_goes(alone: MPI.Comm, tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    for resume in (False, True):
        left = [tmp_path / f".1{UNFINISHED}"]
        left += [tmp_path / "state" / f".2{UNFINISHED}"] if resume else []
        for path in left:
            path.write_text("half")
        with (  # noqa: PT012
            pytest.raises(RunStoppedError),
            open_run(alone, tmp_path, INPUTS, resume=resume) as run,
        ):
            assert not any(path.exists() for path in left)
            run.stop(signal.SIGTERM)
