"""`toros unwrap`: a pattern that others read."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.meshes import read_pattern, read_surface, unwrap
from toros_fem.products.common.options import Unwrapping

FINGER = ROOT / "demos" / "surfaces" / "finger.stl"


def test_pattern_of_the_finger(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "flat"
    words = ["unwrap", str(FINGER), "--output", str(folder), "--json"]
    assert run(alone, words) == 0
    captured = capsys.readouterr()
    pattern = read_pattern(alone, folder / "pattern.npz")
    expected = unwrap(alone, read_surface(alone, FINGER, 1e-3)).pattern
    assert np.array_equal(pattern.flat_points, expected.flat_points)
    assert pattern.panel_names == expected.panel_names
    found = json.loads(captured.out)
    assert found["triangles"] == len(pattern.panel)
    assert found["pattern"] == str(folder / "pattern.npz")


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("--scale", "0"), 2, "scale = 0 m must be a finite number, above 0"),
        (("--scale", "1"), 2, "Give scale = 1e-3 for millimetres (0.09 m), 0.01 for centimetres"),
        (("--crease-angle", "-5"), 2, "crease_angle = -5 deg"),
        (("--component", "3"), 2, "component = 3"),
        (("--output", "/proc/nowhere"), 4, "/proc/nowhere could not be written"),
    ],
)
def test_wrong_values(
    alone: MPI.Comm,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    code: int,
    message: str,
) -> None:
    assert run(alone, ["unwrap", str(FINGER), *words]) == code
    assert message in capsys.readouterr().err


def test_an_unlikely_size_is_told(alone: MPI.Comm, caplog: pytest.LogCaptureFixture) -> None:
    Unwrapping(scale=5e-5).surface(alone, FINGER)
    told = "0.0045 m across with scale = 5e-05 m. In which unit is it? Give scale = 1e-3 for milli"
    assert told in caplog.text


def test_a_new_mesh(alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Edges of 4 mm instead of 2.5 mm."""
    words = ["unwrap", str(FINGER), "--output", str(tmp_path / "flat"), "--json"]
    assert run(alone, [*words, "--remesh", "4mm"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["triangles"] == len(read_pattern(alone, found["pattern"]).panel) < 1000
    assert f"1832 triangles meshed anew by {found['triangles']}" in found["repairs"]
