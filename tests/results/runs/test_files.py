"""Files are whole or as before; checkpoints that are damaged, newer or foreign are told."""

import errno
import json
import os
import resource
import signal
from pathlib import Path

import numpy as np
import pytest

from toros_fem.base.errors import CheckpointError
from toros_fem.base.files import replace_file
from toros_fem.design.loop.journal import Checkpoint
from toros_fem.results.runs import files
from toros_fem.results.runs.files import read_checkpoint, write_checkpoint

OWNER = {"inputs": "a", "problem": "b"}
STATE = Checkpoint(
    {"x": np.asarray(np.linspace(0, 1, 50) ** 3, dtype=np.float64)},
    {"kkt": float("inf"), "history": [0.1]},
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_checkpoint(tmp_path / "000.npz", STATE, OWNER)
    return tmp_path / "000.npz"


def test_what_is_written_is_read(path: Path) -> None:
    found, writer = read_checkpoint(path, OWNER)
    assert np.array_equal(found.arrays["x"], STATE.arrays["x"])
    assert found.numbers == STATE.numbers
    assert writer == files.version()
    assert [p.name for p in path.parent.iterdir()] == [path.name], "nothing is left beside it"


def test_foreign_checkpoints_are_told(path: Path) -> None:
    with pytest.raises(CheckpointError, match="another run: its problem is another"):
        read_checkpoint(path, {**OWNER, "problem": "c"})
    np.savez(path, x=np.zeros(3))
    with pytest.raises(CheckpointError, match="no whole checkpoint"):
        read_checkpoint(path, OWNER)


def test_newer_checkpoints_are_told(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "FORMAT", 2)
    write_checkpoint(path, STATE, OWNER)
    monkeypatch.undo()
    with pytest.raises(CheckpointError, match="has format 2.*reads up to format 1"):
        read_checkpoint(path, OWNER)


def test_pickled_objects_are_refused(path: Path) -> None:
    np.savez(path, header=np.array([{"is": "anything"}], dtype=object))
    with pytest.raises(CheckpointError):
        read_checkpoint(path, OWNER)


def test_damaged_checkpoints_are_told_or_whole(path: Path) -> None:
    whole, rng = path.read_bytes(), np.random.default_rng(1)
    damaged = path.with_name("damaged.npz")
    messages: list[str] = []
    for _ in range(300):
        content = bytearray(whole)
        for _ in range(rng.integers(0, 4)):
            content[rng.integers(len(content))] = rng.integers(256)
        end = rng.integers(len(content) + 1) if rng.random() < 0.3 else len(content)
        damaged.write_bytes(content[:end])
        try:
            found, _ = read_checkpoint(damaged, OWNER)
        except CheckpointError as error:
            messages.append(str(error))
            continue
        # What is changed in a date of the archive's directory alone is not seen.
        assert found.numbers == STATE.numbers
        assert list(found.arrays) == ["x"]
        assert np.array_equal(found.arrays["x"], STATE.arrays["x"])
    assert len(messages) > 150
    assert all(str(damaged) in message for message in messages)


def test_a_full_disk_leaves_the_file_before(path: Path) -> None:
    """A limit on the size of files stands for the disk."""
    before = path.read_bytes()
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        larger = Checkpoint({"x": np.zeros(5000)}, {})
        with pytest.raises(OSError) as caught:  # noqa: PT011
            write_checkpoint(path, larger, OWNER)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name], "no part of it is left"


def test_a_file_is_forced_to_the_disk_before_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    sync, rename = os.fsync, Path.replace

    def noted_sync(number: int) -> None:
        done.append("sync")
        sync(number)

    def noted_rename(one: Path, other: Path) -> Path:
        done.append("rename")
        return rename(one, other)

    monkeypatch.setattr(os, "fsync", noted_sync)
    monkeypatch.setattr(Path, "replace", noted_rename)
    replace_file(tmp_path / "a", json.dumps({}).encode())
    assert done == ["sync", "rename", "sync"], "the folder too"
