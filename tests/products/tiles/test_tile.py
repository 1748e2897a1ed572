"""The demo of a tile: targets, files, bad input."""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.meshes import SYMMETRIES
from toros_fem.products.tiles import tile as demo


@pytest.mark.parametrize("target", list(demo.SYMMETRIES))
def test_targets(alone: MPI.Comm, target: str) -> None:
    case = demo.tile_case(alone, demo.TileScene.of(target=target, edge_length=1e-3))
    coarse, own = (len(one.tile.wraps) for one in (case.coarse, case))
    assert 4 * coarse == own
    assert case.angles[0] == 0
    assert len(case.tile.symmetry_maps(case.symmetry)) == len(SYMMETRIES[case.symmetry])
    assert (case.target is None) == (target == "anisotropic")


def test_own_stiffnesses(alone: MPI.Comm) -> None:
    """Options override the target's own values."""
    config = demo.TileScene.of(target="orthotropic", edge_length=1e-3, stiffness_90=900.0)
    case = demo.tile_case(alone, config)
    assert case.target.stiffness[[0, 3, 6]] == pytest.approx([4000, 1000, 900])


def test_coarse_variant() -> None:
    small = demo.TileScene.of(target="auxetic", seed=5).coarse()
    found = (small.target.target, small.design.seed, small.skin.edge_length)
    assert found == ("auxetic", 5, 0.2e-3)


def test_linear_profile() -> None:
    angles = np.radians([0, 45, 90])
    assert demo.linear_profile(angles, 5.0, 2.0, 1.0) == pytest.approx([5, 2, 1])
    assert demo.linear_profile(np.linspace(0, 1, 5), 3.0, 3.0, 3.0) == pytest.approx(3.0)


def test_doubts_are_told_before_a_design(
    alone: MPI.Comm,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def stop(*_: object) -> None:
        raise NoEquilibriumError("far enough.")

    monkeypatch.setattr(demo, "design_tile", stop)
    scene = demo.TileScene.of(target="anisotropic", edge_length=1e-3, stiffness_90=100.0)
    with pytest.raises(NoEquilibriumError, match="far enough"):
        scene.run_design(alone, tmp_path)
    assert "stiffness_90" in caplog.text
    assert "does not count" in caplog.text
