"""`toros materials`: tables of the library."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.materials.library.files import read_library, write_material


def test_table_with_a_file_of_ones_own(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    write_material(path, replace(read_library()["tpu-85a"], name="my-print"))
    assert run(alone, ["materials", "--kind", "print", "--file", str(path)]) == 0
    text = capsys.readouterr().out
    assert (text == "") == (alone.rank > 0)
    assert run(alone, ["materials", "--kind", "print", "--file", str(path), "--json"]) == 0
    assert "\nmy-print " in text
    assert "jersey-light" not in text
    found = json.loads(capsys.readouterr().out)["materials"]
    assert {entry["kind"] for entry in found} == {"print"}
    assert found[-1]["name"] == "my-print"
    assert found[-1]["young"] == 12e6


def test_one_material(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(MPI.COMM_SELF, ["materials", "dragon-skin-20"]) == 0
    assert "E           290 kPa\n" in capsys.readouterr().out
    assert run(MPI.COMM_SELF, ["materials", "dragon-skin-20", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stretch_range"] == [1.0, 1.3]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["dragon-skin-2"], "LibraryError: 'dragon-skin-2' is no material .* did you mean"),
        (["tpu-85a", "--kind", "fabric"], "'tpu-85a' is a print, and a fabric is asked for"),
        (["--kind", "fabrics"], "kind = 'fabrics' must be one of .*; did you mean 'fabric'?"),
        (["--file", "nowhere.toml"], "there is no nowhere.toml"),
    ],
)
def test_wrong_words(capsys: pytest.CaptureFixture[str], words: list[str], message: str) -> None:
    assert run(MPI.COMM_SELF, ["materials", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(message, error)
