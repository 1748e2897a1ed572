"""What a run advises is done, and what it is for gets better."""

import re
from pathlib import Path
from typing import Any

import pytest
from helpers.designs import DESIGN_ALONE
from mpi4py import MPI

from toros_fem.measures.figures import State, overall
from toros_fem.products.actuators import designer
from toros_fem.products.actuators.result import SkinDesign
from toros_fem.products.tubes import BendScene
from toros_fem.products.walker import WalkerScene

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("without_pictures")]

SCENE = BendScene.of(
    angle=60.0, length=0.08, edge_length=4e-3, filter_radius=6.2e-3, iterations=12, levels=1,
    constrained_iterations=8, polish_iterations=0, corrections=0, **DESIGN_ALONE,
)  # fmt: skip


def miss(found: SkinDesign) -> float:
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


def test_a_finer_mesh_narrows_the_interval(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An uncertain run takes it by itself, and tells so; `check_refinement` asks for it."""
    coarse = SCENE.updated(estimate_error=True, pressure=7e3)
    asked = coarse.updated(check_refinement=2.0).run_design(alone, tmp_path / "asked")
    itself = coarse.run_design(alone, tmp_path / "itself")
    monkeypatch.setattr(designer, "MOST", 100)
    plain = coarse.run_design(alone, tmp_path / "plain")
    assert overall(plain.figures) is State.NOT_CERTAIN
    assert asked.intervals["angle_deg"] < 0.8 * plain.intervals["angle_deg"]
    assert itself.intervals == pytest.approx(asked.intervals)
    assert itself.metrics == pytest.approx(asked.metrics)
    words = "figures of a mesh with edges of 1/2 the length"
    assert words in itself.sentence()
    assert words not in plain.sentence()
    # Another mesh is not asked for where the verdict is plain.
    monkeypatch.undo()
    sure = coarse.updated(tolerance=0.5, shape_tolerance=0.5, direction_tolerance=30.0)
    assert words not in sure.run_design(alone, tmp_path / "sure").sentence()


def test_a_flat_skin_is_always_asked_on_a_finer_mesh(alone: MPI.Comm, tmp_path: Path) -> None:
    """Though coarser meshes are sure of the verdict."""
    scene = WalkerScene.of(
        edge_length=3.6e-3, filter_radius=5.5e-3, iterations=1, constrained_iterations=1,
        polish_iterations=0, corrections=0, gait_steps=None, tolerance=1.0, shape_tolerance=1.0,
        direction_tolerance=90.0, curve_pressure=None,
    )  # fmt: skip
    made = scene.run_design(alone, tmp_path)
    assert made.errors is not None
    assert 0.5 in made.errors.found
    assert "figures of a mesh with edges of 1/2 the length" in made.sentence()


def test_a_design_goes_on_towards_what_it_misses_on_a_finer_mesh(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The better of both is told, with its shape on that mesh."""
    pairs: list[Any] = []
    corrected = designer.Designer._corrected_there

    def spy(self: Any, found: SkinDesign, *given: Any) -> Any:
        other = corrected(self, found, *given)
        pairs.append((found, other))
        return other

    monkeypatch.setattr(designer.Designer, "_corrected_there", spy)
    scene = SCENE.updated(estimate_error=True, pressure=7e3, corrections=1, seed=2)
    made = scene.run_design(alone, tmp_path / "made")
    ((before, (after, there)),) = pairs
    assert miss(after) < miss(before)
    assert miss(made) == pytest.approx(miss(after), rel=1e-9)
    assert made.errors is not None
    problem = there.problem
    told = problem.metrics_of(there.equilibrium)
    assert made.errors.found[0.5].values["angle_deg"] == pytest.approx(told["angle_deg"], rel=1e-9)
    assert made.search.rounds > before.search.rounds
