"""What a run advises is done, and what it is for gets better."""

import re
from pathlib import Path

import pytest
from helpers.designs import DESIGN_ALONE
from mpi4py import MPI

from toros_fem.products.actuators.result import ActuatorResult
from toros_fem.products.tubes.bend import BendScene

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("without_pictures")]

SCENE = BendScene.of(
    angle=60.0, length=0.08, edge_length=4e-3, filter_radius=6.2e-3, iterations=12, levels=1,
    constrained_iterations=8, polish_iterations=0, corrections=0, **DESIGN_ALONE,
)  # fmt: skip


def miss(found: ActuatorResult) -> float:
    """Its worst figure over its tolerance."""
    return max(abs(f.miss / f.tolerance) for f in found.figures if f.tolerance and f.miss)


def test_more_pressure(alone: MPI.Comm, tmp_path: Path) -> None:
    """A pump that is too weak: the advised pressure brings the print nearer to its targets."""
    weak = SCENE.updated(pressure=1.5e3).run_design(alone, tmp_path / "weak")
    (told,) = [text for text in weak.binding if text.startswith("pressure at its bound, 1.5 kPa")]
    (advised,) = re.findall(r'pressure = "(.*) kPa"', told)
    assert float(advised) == 2.25
    more = SCENE.updated(pressure=1e3 * float(advised)).run_design(alone, tmp_path / "more")
    assert miss(more) < 0.8 * miss(weak)


def test_a_finer_mesh_narrows_the_interval(alone: MPI.Comm, tmp_path: Path) -> None:
    """`check_refinement=2`, which an uncertain run advises."""
    coarse = SCENE.updated(estimate_error=True, pressure=5e3)
    plain = coarse.run_design(alone, tmp_path / "plain")
    finer = coarse.updated(check_refinement=2.0).run_design(alone, tmp_path / "finer")
    assert finer.intervals["angle_deg"] < 0.8 * plain.intervals["angle_deg"]
