"""Files are whole or as before; checkpoints that are damaged, newer or foreign are told."""

import json
import os
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
