"""Simulation of a scene's plain skin, and of the print of an earlier design."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE, case_of
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes.files import write_pattern
from toros_fem.products import inflate, tubes

pytestmark = pytest.mark.usefixtures("few_pictures")

SMALL = tubes.BendScene.of(
    length=0.08, edge_length=4.5e-3, filter_radius=7e-3, levels=1, curve_steps=2, pressure=5e3,
    **DESIGN_ALONE,
)  # fmt: skip


def test_plain_skin_is_that_of_inflate(alone: MPI.Comm, tmp_path: Path) -> None:
    """The same tube by another way: its length at the same pressure is the same."""
    found = SMALL.run_simulation(alone, tmp_path / "bend")
    assert found.value("angle_deg") == pytest.approx(0, abs=0.5)
    config = inflate.InflateScene.of(
        length=0.08, edge_length=4.5e-3, highest_pressure=5e3, pressure=2.5e3, levels=2
    )
    other = config.updated(whole=True).run_simulation(alone, tmp_path / "inflate")
    percent, ratio = other.value("length_percent"), found.value("length_ratio")
    assert 100 * ratio == pytest.approx(percent, rel=5e-3)
    written = json.loads((tmp_path / "bend" / "summary.json").read_text(encoding="utf-8"))
    assert written["inputs"] == SMALL.as_dict()
    assert written["failure"] is None
    for name in ("curve.csv", "curve.png", "inflation.png", "skin.vtu"):
        assert (tmp_path / "bend" / name).exists()
    assert found.sentence().endswith("at 5.00 kPa, plain skin")


def test_a_finer_mesh_is_told(alone: MPI.Comm, tmp_path: Path) -> None:
    checked = SMALL.updated(estimate_error=True, check_refinement=2.0, curve_steps=1)
    found = checked.run_simulation(alone, tmp_path)
    errors_of = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["errors"]
    assert [*errors_of["meshes"]] == ["1.0", "1.5", "2.25", "0.5"]
    (length,) = (figure for figure in found.figures if figure.key == "length_ratio")
    finer = errors_of["meshes"]["0.5"]["length_ratio"]
    again = SMALL.updated(edge_length=2.25e-3, curve_steps=1)
    near = again.run_simulation(alone, tmp_path / "again").value("length_ratio")
    assert finer == pytest.approx(near, rel=1e-6)
    assert length.value == finer
    assert found.points[-1].metrics["length_ratio"] == errors_of["meshes"]["1.0"]["length_ratio"]
    assert 0 < length.interval < 0.1 * abs(length.value - 1)


def test_what_is_refused(alone: MPI.Comm, tmp_path: Path) -> None:
    pattern = case_of(alone, SMALL).pattern
    write_pattern(tmp_path / "plain.npz", pattern)
    with pytest.raises(errors.FileError, match="does not say which triangles are printed"):
        SMALL.run_simulation(alone, tmp_path, {"pattern": tmp_path / "plain.npz"})


def test_a_pressure_that_was_designed_is_told(
    alone: MPI.Comm, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A scene's own pressure is the most that its design may take."""
    scene, run = SMALL.updated(curve_steps=1), tmp_path / "run"
    run.mkdir()
    pattern = case_of(alone, scene).pattern
    write_pattern(run / "pattern.npz", pattern, printed=np.zeros(len(pattern.panel), dtype=bool))
    summary = {"figures": [], "pressures_pa": [6e3]}
    (run / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    for pressure, told in ((5e3, True), (6e3, False)):
        caplog.clear()
        own = scene.updated(pressure=pressure)
        own.run_simulation(alone, tmp_path / "again", {"pattern": run})
        assert ('--set pressure="6 kPa"' in caplog.text) is told
