"""`toros new`: a scene file of each kind that reads back as it is."""

import json
from pathlib import Path

import pytest
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files.reading import read_scene


def test_nothing_is_overwritten(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.toml"
    assert run(alone, ["new", "bend", str(path)]) == 0
    capsys.readouterr()
    assert run(alone, ["new", "twist", str(path)]) == 2
    error = capsys.readouterr().err
    assert "is there already; give another name, or --force." in error
    assert read_scene(path, comm=alone).kind.name == "bend"
    assert run(alone, ["new", "twist", str(path), "--force", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found == {"command": "new", "exit_code": 0, "file": str(path), "kind": "twist"}
    assert read_scene(path, comm=alone).kind.name == "twist"
