"""A file is on the disk before it has its name; contracts/test_files.py has the rest."""

import json
import os
from pathlib import Path

import pytest

from toros_fem.base.files import replace_file


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
