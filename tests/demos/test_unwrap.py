"""The demo that unwraps a surface of one's own: what it writes, and its command line."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import pytest
from helpers.scenes import DATA
from mpi4py import MPI

from demos import unwrap as demo
from toros_fem.cli.commands.unwrap import UnwrapConfig, unwrap_sentence


def test_a_part_from_a_file(alone: MPI.Comm, tmp_path: Path) -> None:
    folder = tmp_path / "bracket"
    config = UnwrapConfig(scale=1e-3)
    summary = demo.run(alone, folder, config, file=DATA / "bracket.stl")
    assert summary["triangles"] == 494
    assert set(summary["panels"].values()) == {"exact", "abf"}
    assert "494 triangles (repairs: none) in 7 panels" in unwrap_sentence(summary)
    assert (folder / "unwrap.png").stat().st_size > 10_000
    cell_data = meshio.read(folder / "surface.vtu").cell_data
    assert cell_data["area_ratio"][0] == pytest.approx(1, abs=1e-3)
    panels = ET.parse(folder / "pattern.svg").getroot().findall("{http://www.w3.org/2000/svg}g")
    assert [group.get("id") for group in panels] == list(summary["panels"])
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written == summary
    assert UnwrapConfig(**written["inputs"]) == config


def test_capsule(alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a file, in a single panel where any stretch is allowed; the table on request."""
    assert demo.capsule(12, 0.02, 0.04).closed
    config = UnwrapConfig(seams="auto", max_stretch=10.0)
    summary = demo.run(alone, tmp_path, config, verbose=True)
    assert summary["file"] is None
    assert summary["closed"]
    assert summary["worst_stretch"] <= 10
    assert "longest difference at a seam" in capsys.readouterr().out
