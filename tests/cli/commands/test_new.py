"""`toros new`: a scene file of each kind that reads back as it is."""

import json
from pathlib import Path

import pytest
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files.reading import read_scene
from toros_fem.products.kinds import KINDS


@pytest.mark.parametrize("kind", list(KINDS))
def test_each_kind(comm: MPI.Comm, tmp_path: Path, kind: str) -> None:
    path = shared(comm, tmp_path) / "scenes" / "mine.toml"
    assert run(comm, ["new", kind, str(path)]) == 0
    scene = read_scene(path, comm=comm)
    assert scene.kind is KINDS[kind]
    assert scene.config == KINDS[kind].example


def test_nothing_is_overwritten(
    comm: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = shared(comm, tmp_path) / "mine.toml"
    assert run(comm, ["new", "bend", str(path)]) == 0
    capsys.readouterr()
    assert run(comm, ["new", "twist", str(path)]) == 2
    error = capsys.readouterr().err
    assert ("is there already; give another name, or --force." in error) == (comm.rank == 0)
    assert read_scene(path, comm=comm).kind.name == "bend"
    assert run(comm, ["new", "twist", str(path), "--force", "--json"]) == 0
    if comm.rank == 0:
        found = json.loads(capsys.readouterr().out)
        assert found == {"command": "new", "exit_code": 0, "file": str(path), "kind": "twist"}
    assert read_scene(path, comm=comm).kind.name == "twist"


def test_unknown_kind(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(MPI.COMM_SELF, ["new", "own-msh", "x.toml"]) == 2
    error = capsys.readouterr().err
    assert error == "toros new: unknown kind 'own-msh'; did you mean own-mesh?\n"


def test_a_place_that_cannot_be_written(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(MPI.COMM_SELF, ["new", "bend", "/proc/nowhere/x.toml"]) == 4
    assert "/proc/nowhere could not be written" in capsys.readouterr().err
