"""A run that ends at any write leaves whole files, and goes on or is refused by name."""

from __future__ import annotations

import errno
import os
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base import files
from toros_fem.base.errors import CheckpointError, OutputError
from toros_fem.base.files import UNFINISHED, Archive, guarded, write_json, write_table
from toros_fem.results.runs.open_run import NAME, RunJournal, open_run, read_record

# The child writes files alone, and uses none of the threads that it does not have.
pytestmark = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
ALONE, INPUTS, STEPS = MPI.COMM_SELF, {"length": 0.1}, 3
# Files of a person in the folder of a run.
OWN = ("notes.txt", "frames/my.npz", "state/mine.npz")


def state(number: int) -> Archive:
    return Archive(
        "checkpoint", {"x": np.linspace(0, 4, 5, dtype=np.float64) ** number}, {"step": number}
    )


def run(folder: Path, **how: Any) -> None:
    """A tiny run: its scene, its record, a state after each step, a table and a summary."""
    with open_run(ALONE, folder, INPUTS, scene="# mine\n", every=1, **how) as opened:
        entry = opened.journal(folder).entry(ALONE, "loop")
        saved = entry.saved()
        done = 0 if saved is None else int(saved.numbers["step"])
        for number in range(done + 1, STEPS + 1):
            rows = [{"step": k} for k in range(number + 1)]
            guarded(ALONE, folder, partial(write_table, folder / "history.csv", rows))
            entry.offer(partial(state, number), last=number == STEPS)
        summary = partial(write_json, folder / "summary.json", {"steps": STEPS})
        guarded(ALONE, folder, summary)


def contents(folder: Path) -> dict[str, bytes]:
    """All files in a run's folder by their place, without what tells processes."""
    places = {path.relative_to(folder): path for path in sorted(folder.rglob("*"))}
    return {
        place.as_posix(): path.read_bytes()
        for place, path in places.items()
        if path.is_file() and place.name != NAME
    }


Fault = Callable[[], Any]


def failing_at(patch: pytest.MonkeyPatch, number: int, fault: Fault) -> list[int]:
    """Let the n-th step of writing fail: content to disk, new name, name to disk; count them."""
    count, sync, rename = [0], os.fsync, Path.replace

    def step() -> None:
        count[0] += 1
        if count[0] == number:
            fault()

    def synced(handle: int) -> None:
        step()
        sync(handle)

    def renamed(one: Path, other: Path) -> Path:
        step()
        return rename(one, other)

    patch.setattr(os, "fsync", synced)
    patch.setattr(Path, "replace", renamed)
    return count


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[int, dict[str, set[bytes]]]:
    """How many steps of writing a run has, and all contents that each of its files ever has."""
    found: dict[str, set[bytes]] = {}
    replace, folder = files.replace_file, tmp_path / "whole"

    def noted(path: Path, content: bytes) -> None:
        found.setdefault(path.relative_to(folder).as_posix(), set()).add(content)
        replace(path, content)

    with monkeypatch.context() as patch:
        for module in ("base.files", "results.runs.open_run"):
            patch.setattr(f"toros_fem.{module}.replace_file", noted)
        count = failing_at(patch, 0, lambda: None)
        run(folder)
    return count[0], found


def child(action: Callable[[], None]) -> int:
    """Do something in a process of its own; return how it ended."""
    pid = os.fork()
    if pid == 0:
        try:
            action()
            os._exit(0)
        except BaseException:
            os._exit(1)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def check(folder: Path, written: dict[str, set[bytes]], earlier: dict[str, bytes]) -> None:
    """Each file is the old or a new one, and both ways to go on lead to the whole run."""
    for name, content in contents(folder).items():
        if not name.endswith(UNFINISHED):
            assert content in written.get(name, set()) | {earlier.get(name)}, name
    if "state/run.json" in contents(folder):
        if read_record(ALONE, folder)[0].finished:
            run(folder, overwrite=True)
        else:
            run(folder, resume=True)
    else:  # nothing but a lock is there
        run(folder)
    last = contents(folder)
    assert {name for name in written if "summary" in name or "history" in name} <= set(last)
    assert read_record(ALONE, folder)[0].finished
    assert b'"steps": 3' in last["summary.json"]
    run(folder, overwrite=True)  # and a fresh one begins in its place
    assert read_record(ALONE, folder)[0].finished


@pytest.mark.parametrize("before", [False, True], ids=["new folder", "after an earlier run"])
@pytest.mark.parametrize("kind", ["killed", "full disk"])
def test_a_fault_at_each_write(
    kind: str, before: bool, written: tuple[int, dict[str, set[bytes]]], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    steps, known = written
    assert steps > 3 * STEPS
    for number in range(1, steps + 1):
        folder, how = tmp_path / f"{kind} {number}", {"overwrite": before}
        earlier: dict[str, bytes] = {}
        if before:
            run(folder)
            for name in OWN:
                (folder / name).parent.mkdir(exist_ok=True)
                (folder / name).write_text("mine")
            earlier = contents(folder)
        with monkeypatch.context() as patch:
            if kind == "killed":
                failing_at(patch, number, lambda: os._exit(9))
                assert child(partial(run, folder, **how)) == 9
            else:
                failing_at(patch, number, full)
                with pytest.raises(OutputError, match="No space left"):
                    run(folder, **how)
                assert not list(folder.rglob(f"*{UNFINISHED}")), "nothing is left beside a file"
        check(folder, known, earlier)
        assert not before or {(folder / name).read_text() for name in OWN} == {"mine"}


def full() -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("how", ["resume", "overwrite"])
def test_a_folder_in_use(how: str, tmp_path: Path) -> None:
    """Refused with the process that uses it, until that is dead."""
    folder = tmp_path / "run"
    options: dict[str, Any] = {how: True}
    with pytest.MonkeyPatch.context() as patch:
        failing_at(patch, 8, lambda: os._exit(9))
        assert child(partial(run, folder)) == 9
    reader, writer = os.pipe()
    other = os.fork()
    if other == 0:
        try:
            with open_run(ALONE, folder, INPUTS, resume=True):
                os.write(writer, b"locked")
                signal.pause()
        finally:
            os._exit(0)
    try:
        assert os.read(reader, 6) == b"locked"
        before = contents(folder)
        with pytest.raises(OutputError, match=f"process {other} on "):
            open_run(ALONE, folder, INPUTS, **options)
        assert contents(folder) == before, "nothing was removed"
    finally:
        os.kill(other, signal.SIGKILL)
        os.waitpid(other, 0)
    with open_run(ALONE, folder, INPUTS, **options):  # noqa: SIM117
        with pytest.raises(OutputError, match="in use"):
            open_run(ALONE, folder, INPUTS, **options)


def changed(content: bytes, kind: str, place: int) -> bytes:
    """A file with a byte changed, cut off, or with bytes of zeros."""
    if kind == "cut":
        return content[:place]
    if kind == "zeros":
        return content[:place] + bytes(min(64, len(content) - place)) + content[place + 64 :]
    return content[:place] + bytes([content[place] ^ 0x55]) + content[place + 1 :]


@pytest.mark.parametrize("kind", ["byte", "cut", "zeros"])
def test_a_checkpoint_with_any_byte_changed_is_refused(kind: str, tmp_path: Path) -> None:
    """Its directory too, where a changed name drops an array."""
    folder = tmp_path / "run"
    with pytest.MonkeyPatch.context() as patch:
        failing_at(patch, 20, lambda: os._exit(9))
        assert child(partial(run, folder)) == 9
    path = folder / "state" / "000.npz"
    whole = path.read_bytes()
    refused = 0
    with open_run(ALONE, folder, INPUTS, resume=True) as opened:
        for place in range(0, len(whole), 3):
            path.write_bytes(changed(whole, kind, place))
            entry = RunJournal(opened, "").entry(ALONE, "loop")
            try:
                found = entry.saved()
            except CheckpointError as caught:
                message = str(caught)
            else:  # a byte that nothing reads, as the time of a member
                step = int(found.numbers["step"])
                assert np.array_equal(found.arrays["x"], state(step).arrays["x"])
                continue
            refused += 1
            assert message.startswith(f"{path} "), "by its name"
    assert refused > len(whole) / 3 / 2
    path.unlink()  # this loop begins anew
    record = folder / "state" / "run.json"
    record.write_text(record.read_text().replace('"finished": true', '"finished": false'))
    run(folder, resume=True)
    assert read_record(ALONE, folder)[0].finished
