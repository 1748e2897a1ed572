"""A file is on the disk before it has its name, and the table of files has all of them."""

import csv
import json
import os
import re
from pathlib import Path

import pytest
from helpers.scenes import ROOT

from toros_fem.base.files import replace_file
from toros_fem.results.runs.stored_run import FILES

# Commands that write no run.
OTHERS = {"export", "fit", "fit_skin", "unwrap"}


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


def test_every_file_of_a_run_is_in_the_table() -> None:
    """And each entry is a file that some run writes, or that `toros view` adds."""
    with (ROOT / "tests" / "golden" / "file_heads.csv").open(encoding="utf-8") as file:
        rows = [(name, set(runs.split(", "))) for name, runs in csv.reader(file) if ":" not in name]
    written = {name.partition("/")[0] for name, runs in rows if runs - OTHERS}
    known = {name.partition("/")[0] for name in FILES}
    assert written <= known
    assert all(
        name.endswith((".gif", ".apng")) for name in known - written - {"wrinkles.png", "poses.png"}
    )


def test_the_tutorial_names_files_of_the_table() -> None:
    page = ROOT / "docs" / "tutorial" / "first_design.md"
    names = re.findall(r"`run/([^`]+)`", page.read_text(encoding="utf-8"))
    assert len(names) == 4
    numbered = {re.sub(r"print_1\.3mf|cut_1\.svg", "make_it.html", name) for name in names}
    assert numbered <= set(FILES)
