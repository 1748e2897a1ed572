"""The demo of a tile: targets, files, bad input."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import SYMMETRIES
from toros_fem.products.tile_design import tile as demo
from toros_fem.products.tiles.printed_tile import read_tile

SMALL = demo.TargetTileConfig(
    edge_length=0.8e-3,
    filter_radius=2e-3,
    starts=2,
    trial_iterations=2,
    draft_iterations=2,
    finish_iterations=2,
    corrections=0,
)


@pytest.mark.slow
def test_demo(comm: MPI.Comm, tmp_path: Path) -> None:
    folder = shared(comm, tmp_path) / "tile"
    summary = demo.run(comm, folder, SMALL.updated(fabric_young=0.2e6))
    comm.barrier()
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written["ranks"] == comm.size
    assert written["printed"] == summary["printed"]
    assert len(summary["trials"]) == 2
    assert len(summary["corrections_percent"]) == 1
    assert summary["worst_percent"] == pytest.approx(min(summary["corrections_percent"]))
    target = np.array(summary["target"]["stiffness_n_per_m"])
    assert target == pytest.approx([2000, 1000, 500, 400])
    printed = np.array(summary["printed"]["stiffness_n_per_m"])
    assert summary["worst_percent"] == pytest.approx(100 * np.abs(printed / target - 1).max())
    assert len(summary["buckling"]) == len(target)
    assert summary["inputs"]["target"] == "tetragonal"
    assert summary["inputs"]["stiffness_0"] is None
    assert 0 < summary["seconds"]["setup"] < summary["seconds"]["total"]
    made = read_tile(comm, folder)
    assert made.composite.fabric.young == 0.2e6
    assert 0 < made.tile(comm).pattern.areas[made.printed].sum() < 1e-4
    history = (folder / "history.csv").read_text(encoding="utf-8").splitlines()
    assert history[0].endswith(",worst_percent")
    text = demo.sentence(summary)
    assert f"at most {summary['worst_percent']:.1f} % from the target" in text
    found = summary["manufacture"]
    assert f"; {found['islands']} islands, lines from {found['smallest_width_mm']:.2f} mm" in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"target": "softest"}, "target = 'softest' must be one of 'orthotropic'"),
        ({"edge_length": 3e-3}, "edge_length = 0.003 m must be at most 0.002 m"),
        ({"stiffness_45": -3.0}, "stiffness_45 = -3.0 N/m must be a finite number, above 0"),
        ({"contraction": 2.0}, "contraction = 2.0"),
        ({"directions": 0}, "directions = 0"),
        ({"presure": 1.0}, "unknown parameter 'presure'"),
    ],
)
def test_bad_input(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.ParameterError, match=message):
        SMALL.updated(**changes)


@pytest.mark.parametrize("target", list(demo.SYMMETRIES))
def test_targets(comm: MPI.Comm, target: str) -> None:
    case = demo.tile_case(comm, demo.TargetTileConfig(target=target, edge_length=1e-3))
    assert case.coarse is not None
    assert case.fine is not None
    assert 4 * len(case.coarse.pattern.panel) == len(case.tile.pattern.panel)
    assert len(case.fine.pattern.panel) == 4 * len(case.tile.pattern.panel)
    assert case.angles[0] == 0
    assert len(case.tile.symmetry_maps(case.symmetry)) == len(SYMMETRIES[case.symmetry])
    assert (case.target is None) == (target == "anisotropic")


def test_own_stiffnesses(comm: MPI.Comm) -> None:
    """Options override the target's own values."""
    config = demo.TargetTileConfig(target="orthotropic", edge_length=1e-3, stiffness_90=900.0)
    case = demo.tile_case(comm, config)
    assert case.target is not None
    assert case.target.stiffness is not None
    assert case.target.stiffness[[0, 3, 6]] == pytest.approx([2000, 500, 900])


def test_coarse_variant() -> None:
    small = demo.coarse(demo.TargetTileConfig(target="auxetic", seed=5))
    assert (small.target, small.seed, small.edge_length) == ("auxetic", 5, 0.2e-3)


def test_linear_profile() -> None:
    angles = np.radians([0, 45, 90])
    assert demo.linear_profile(angles, 5.0, 2.0, 1.0) == pytest.approx([5, 2, 1])
    assert demo.linear_profile(np.linspace(0, 1, 5), 3.0, 3.0, 3.0) == pytest.approx(3.0)
