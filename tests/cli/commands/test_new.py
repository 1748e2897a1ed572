"""`toros new`: a scene file of each kind that reads back as it is."""

import json
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files import read_scene
from toros_fem.products.kinds import KINDS


def test_nothing_is_overwritten(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    assert run(alone, ["new", "bend", str(path)]) == 0
    capsys.readouterr()
    assert run(alone, ["new", "twist", str(path)]) == 2
    error = capsys.readouterr().err
    assert "is there already; give another name, or --force." in error
    assert read_scene(path, comm=alone).kind.KIND == "bend"
    assert run(alone, ["new", "twist", str(path), "--force", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found == {"command": "new", "exit_code": 0, "file": str(path), "kind": "twist"}
    assert read_scene(path, comm=alone).kind.KIND == "twist"


@pytest.mark.parametrize("name", list(KINDS))
def test_a_short_scene_is_the_whole_one(alone: MPI.Comm, tmp_path: Path, name: str) -> None:
    """It has a dozen keys at most, and the numbers of the scene with all of them."""
    short, whole = tmp_path / "short.toml", tmp_path / "whole.toml"
    assert run(alone, ["new", name, str(short)]) == 0
    assert run(alone, ["new", name, str(whole), "--all"]) == 0
    few, every = configs = [read_scene(path).config for path in (short, whole)]
    assert every == KINDS[name].example()
    if "material" in every.tables():  # what the names stand for is told as numbers
        sheets: list[Any] = [vars(one)["material"] for one in configs]
        assert sheets[0].composite == sheets[1].composite
        few = few.updated(material=sheets[1])
    assert few == every
    text = short.read_text("utf-8")
    keys = [line for line in text.splitlines() if " = " in line and line[0] != "#"]
    assert 4 <= len(keys) <= 16
    assert set(KINDS[name].FEW) <= {line.partition(" = ")[0] for line in keys}


def test_materials_by_name(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    words = ["new", "walker", str(path), "--fabric", "rib-knit", "--print", "tpu-85a"]
    assert run(alone, words) == 0
    assert run(alone, ["check", str(path)]) == 0
    found = read_scene(path)
    names = {role: entry.name for role, entry in found.materials.items()}
    assert names == {"fabric": "rib-knit", "reinforcement": "tpu-85a"}
    assert run(alone, ["new", "bend", str(path), "--force", "--fabric", "rib-knit"]) == 0
    assert read_scene(path).materials["reinforcement"].name == "printed-tpu-95a"
    capsys.readouterr()
    for kind, more, message in [
        ("bend", ["--print", "tpu-95"], "did you mean 'tpu-95a'?"),
        ("bend", ["--print", "rib-knit"], "is a fabric, and a print is asked for"),
        ("tile", ["--bladder", "dragon-skin-20"], "of the kind 'tile' have no bladder"),
        ("bend", ["--all", "--fabric", "rib-knit"], "give no names with it"),
    ]:
        assert run(alone, ["new", kind, str(path), "--force", *more]) == 2
        assert message in capsys.readouterr().err
