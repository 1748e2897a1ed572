"""`toros explain`: a key in all kinds that have it."""

import json

import pytest
from mpi4py import MPI

from toros_fem.cli.commands.main import run


def test_a_key_in_all_kinds(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(MPI.COMM_SELF, ["explain", "pressure.pressure", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["found"]
    guess, inflated = sorted(found, key=lambda one: -len(one["default"]))
    assert guess["help"].endswith("in Pa; at least 0")
    assert guess["default"]["bend"] == "10 kPa"
    assert guess["default"]["walker"] == "20 kPa"
    assert inflated["default"] == {"inflate": "10 kPa"}


def test_a_key_of_one_kind(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(MPI.COMM_SELF, ["explain", "levels", "--kind", "walker"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("[design] levels: number of meshes, from coarse to fine")
    assert text.splitlines()[1].split() == ["default", "1", "of", "walker"]
    assert run(MPI.COMM_SELF, ["explain", "components", "--kind", "own-mesh"]) == 0
    assert "[held] components" in capsys.readouterr().out


def test_an_unknown_key_has_a_neighbour(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(MPI.COMM_SELF, ["explain", "filter_radios"]) == 2
    assert "did you mean 'filter_radius'?" in capsys.readouterr().err
    assert run(MPI.COMM_SELF, ["explain", "walker"]) == 2
    assert "walker is a kind of scene" in capsys.readouterr().err
    assert run(MPI.COMM_SELF, ["check", "a.toml", "--set", "seed=1", "levels=2"]) == 2
    assert "levels=2 stands alone; write --set before each KEY=VALUE" in capsys.readouterr().err
