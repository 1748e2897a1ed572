"""Intervals of a print from other meshes, of which some may have no equilibrium."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.measures.figures import Figure
from toros_fem.mechanics.readings.error_estimate import LimitShape, half_width
from toros_fem.meshes import Pattern
from toros_fem.products.actuators import estimates
from toros_fem.products.actuators.estimates import MetricErrors, metric_errors, trial_intervals


def found(
    monkeypatch: pytest.MonkeyPatch,
    meshes: int = 9,
    without: tuple[int, ...] = (),
    refinement: float | None = None,
) -> MetricErrors:
    """The errors of a mean, which each coarser mesh, a number, tells as 10 less than the last."""
    pattern = square(n=2)
    printed = np.ones(len(pattern.panel))

    def coarser(level: int) -> tuple[float, int]:
        if level == meshes:
            raise ParameterError("there is no coarser mesh.")
        return 2.0, level + 1

    def simulated(_: Any, level: int, *__: Any) -> int:
        if level in without:
            raise NoEquilibriumError(f"none on mesh {level}.")
        return level

    def told(level: int) -> dict[str, float]:
        return {"x_mm": 100.0 - (10 * level if level > 0 else level)}

    def shape(level: int) -> LimitShape:
        at = np.full_like(pattern.points, 1e-3 * told(level)["x_mm"])
        return LimitShape(pattern, at, at, printed)

    def own(level: int, keys: list[str]) -> dict[str, float]:
        return {key: shape(level).half_width(mean) for key in keys}

    monkeypatch.setattr(estimates, "simulated_on", simulated)
    monkeypatch.setattr(estimates, "_told", told)
    monkeypatch.setattr(estimates, "_half_widths", own)
    scene = SimpleNamespace(
        coarser=coarser,
        finer=lambda level, ratio: (1 / ratio, level - 1),
        results=SimpleNamespace(check_refinement=refinement),
    )
    job: Any = SimpleNamespace(scene=scene, comm=MPI.COMM_SELF)

    def mean(_: Pattern, positions: np.ndarray) -> float:
        return 1e3 * float(positions[:, 0].mean())

    level: Any = 0
    return metric_errors(job, level, shape(0), {"x_mm": mean}, None, None)


def test_all_coarser_meshes_count(monkeypatch: pytest.MonkeyPatch) -> None:
    both = found(monkeypatch)
    assert both.other_meshes == {2.0: {"x_mm": 90.0}, 4.0: {"x_mm": 80.0}}
    assert both.failure is None
    near, far = found(monkeypatch, without=(2,)), found(monkeypatch, without=(1,))
    assert (list(near.other_meshes), list(far.other_meshes)) == ([2.0], [4.0])
    assert near.intervals["x_mm"] > both.intervals["x_mm"], "a single mesh counts as of order 1"
    rest = near.intervals["x_mm"] - 1.25 * 10 / (2 - 1)
    assert far.intervals["x_mm"] == pytest.approx(rest + 1.25 * 20 / (4 - 1))
    assert both.intervals["x_mm"] == pytest.approx(rest + 1.25 * 10 / (2**1.5 - 1))


def test_without_any_coarser_mesh_the_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    none = found(monkeypatch, without=(1, 2))
    assert none.failure == "none on mesh 1."
    assert not none.intervals
    assert not none.other_meshes
    assert found(monkeypatch, meshes=0).failure == "there is no coarser mesh."


def test_a_finer_mesh_narrows_the_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is that of the finer mesh around its value, seen from what is told."""
    alone, checked = found(monkeypatch), found(monkeypatch, refinement=2.0)
    assert checked.other_meshes == {0.5: {"x_mm": 101.0}, 2.0: {"x_mm": 90.0}, 4.0: {"x_mm": 80.0}}
    pattern = square(n=2)
    fine = LimitShape(pattern, pattern.points, pattern.points + 0.101, np.ones(8))
    at_rest = 1e3 * float(pattern.points[:, 0].mean())
    own = 0.03 * fine.edges_to_width * (101 - at_rest)
    width = 1.0 + half_width(own, {2.0: 1.0, 4.0: 11.0, 8.0: 21.0})
    assert checked.intervals["x_mm"] == pytest.approx(width)
    assert width < alone.intervals["x_mm"]
    # Where it has no equilibrium the coarser meshes tell the interval.
    assert found(monkeypatch, refinement=2.0, without=(-1,)).intervals == alone.intervals
    # Alone it counts as of order 1.
    single = found(monkeypatch, refinement=2.0, meshes=0)
    assert single.intervals["x_mm"] == pytest.approx(1.0 + half_width(own, {2.0: 1.0}))


@pytest.mark.parametrize(("ratio", "width"), [(1.5, 7.5), (0.5, 3.0 + 3.75)])
def test_a_trial_is_repeated_on_another_mesh(ratio: float, width: float) -> None:
    """Its figures have intervals of order 1; what is missing on one mesh has none."""
    told = [Figure("stride", "mm", 20.0), Figure("slip", "mm", 2.0), Figure("gap", "mm", None)]
    there = [Figure("stride", "mm", 17.0), Figure("slip", "mm", None), Figure("gap", "mm", 1.0)]
    asked: list[Any] = []

    def again(comm: MPI.Comm, made: Any) -> list[Figure]:
        asked.append(made)
        return there

    made: Any = "coarser"
    scene: Any = SimpleNamespace(trial_figures=again, TRIAL_MESH=ratio)
    comm = MPI.COMM_SELF
    widths = trial_intervals(comm, scene, told, lambda: made)
    assert widths == {"stride_mm": pytest.approx(width)}
    assert asked == [made]
    wider = trial_intervals(comm, scene, told, lambda: made, {"stride_mm": 2.0})
    assert wider == {"stride_mm": pytest.approx(width + 1.25 * 2.0)}
    assert trial_intervals(comm, scene, told, None) == {}
    assert asked == [made, made]

    def fails() -> Any:
        raise NoEquilibriumError("none there.")

    assert trial_intervals(comm, scene, told, fails) == {}
