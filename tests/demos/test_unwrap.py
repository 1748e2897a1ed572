"""The demo that unwraps a surface of one's own: what it writes, and its command line."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import pytest
from helpers.scenes import DATA, ROOT
from mpi4py import MPI

from demos import unwrap as demo
from toros_fem import errors
from toros_fem.cli.commands.unwrap import UnwrapConfig, unwrap_sentence


def test_a_part_from_a_file(comm: MPI.Comm, tmp_path: Path) -> None:
    folder = comm.bcast(tmp_path, root=0) / "bracket"
    config = UnwrapConfig(scale=1e-3)
    summary = demo.run(comm, folder, config, file=DATA / "bracket.stl")
    assert summary["triangles"] == 494
    assert set(summary["panels"].values()) == {"exact", "abf"}
    assert "494 triangles (repairs: none) in 7 panels" in unwrap_sentence(summary)
    comm.barrier()
    assert (folder / "unwrap.png").stat().st_size > 10_000
    cell_data = meshio.read(folder / "surface.vtu").cell_data
    assert cell_data["area_ratio"][0] == pytest.approx(1, abs=1e-3)
    panels = ET.parse(folder / "pattern.svg").getroot().findall("{http://www.w3.org/2000/svg}g")
    assert [group.get("id") for group in panels] == list(summary["panels"])
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written == summary
    assert UnwrapConfig(**written["inputs"]) == config


def test_capsule(comm: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a file, in a single panel where any stretch is allowed; the table on request."""
    assert demo.capsule(12, 0.02, 0.04).closed
    folder = comm.bcast(tmp_path, root=0)
    config = UnwrapConfig(seams="auto", max_stretch=10.0)
    summary = demo.run(comm, folder, config, verbose=True)
    assert summary["file"] is None
    assert summary["closed"]
    assert summary["worst_stretch"] <= 10
    assert ("longest difference at a seam" in capsys.readouterr().out) == (comm.rank == 0)


def test_values_out_of_bounds_are_named() -> None:
    with pytest.raises(errors.ParameterError, match=r"scale = 0 m .* above 0"):
        UnwrapConfig(scale=0)
    with pytest.raises(errors.ParameterError, match=r"component = -1 .* at least 0"):
        UnwrapConfig(component=-1)
    with pytest.raises(errors.ParameterError, match="method = 'best' must be one of 'auto'"):
        UnwrapConfig(method="best")


@pytest.mark.slow
def test_command_line(comm: MPI.Comm, tmp_path: Path) -> None:
    """The file is named without an option; None is written "none"."""
    if comm.size > 1:
        pytest.skip("starts processes of its own")
    script = [sys.executable, str(ROOT / "demos" / "unwrap.py")]
    good = [str(DATA / "bracket.stl"), "--scale", "1e-3", "--component", "none", "--output"]
    done = subprocess.run([*script, *good, str(tmp_path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("494 triangles (repairs: none) in 7 panels: stretch 0.0")
    words = ["missing.stl", "--output", str(tmp_path / "bad")]
    bad = subprocess.run([*script, *words], capture_output=True, text=True)
    assert (bad.returncode, bad.stderr) == (2, "SurfaceError: there is no file missing.stl.\n")
