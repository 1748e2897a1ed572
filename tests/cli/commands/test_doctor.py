"""`toros doctor`: what it says is so."""

import json
from pathlib import Path

import dolfinx
import pytest
from mpi4py import MPI

from toros_fem.cli.commands.main import run


def test_doctor(
    alone: MPI.Comm,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert run(alone, ["doctor", "--json"]) == 0
    captured = capsys.readouterr()
    if alone.rank:
        assert captured.out == ""
        return
    found = json.loads(captured.out)
    assert found["versions"]["dolfinx"] == dolfinx.__version__
    assert found["mpi"]["ranks"] == alone.size
    assert any(found["solvers"].values())
    assert found["tried"]["triangles"] > 100
    assert found["tried"]["newton_steps"] > 1
    for place, size in found["caches"].items():
        assert (size is None) == (not Path(place).is_dir())


def test_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(MPI.COMM_SELF, ["doctor", "--no-solve"]) == 0
    text = capsys.readouterr().out
    assert f"dolfinx      {dolfinx.__version__}\n" in text
    assert "tried" not in text
