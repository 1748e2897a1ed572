"""Intervals of a print from other meshes, of which some may have no equilibrium."""

import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.measures.figures import Figure
from toros_fem.mechanics.readings.error_estimate import edge_of, half_width
from toros_fem.meshes import Pattern
from toros_fem.products.actuators import estimates
from toros_fem.products.actuators.estimates import (
    COARSER_MESHES,
    MeshValues,
    MetricErrors,
    SimulatedPrint,
    coarser_levels,
    metric_errors,
    near_on_coarser,
    trial_intervals,
)
from toros_fem.products.tubes import BendScene


def levels_tried(
    monkeypatch: pytest.MonkeyPatch, meshes: int, without: tuple[int, ...] = ()
) -> tuple[list[tuple[int, Any]], Any]:
    """The levels in the order in which they are simulated, each with its start; and the result.

    Level 0 is the print's own, and each next one is coarser. The shape on one is its number.
    """
    tried: list[tuple[int, Any]] = []

    def coarser(level: int) -> tuple[float, int]:
        if level == meshes:
            raise ParameterError("there is no coarser mesh.")
        return 1.5, level + 1

    def simulated(_: Any, level: int, again: SimulatedPrint, ratio: float) -> Any:
        tried.append((level, again.near))
        assert ratio == pytest.approx(1.5**level)
        if level in without:
            raise NoEquilibriumError("none")
        skin = SimpleNamespace(pattern=level, gather_vertices=lambda positions: positions)
        problem = SimpleNamespace(skin=skin)
        return SimpleNamespace(problem=problem, equilibrium=SimpleNamespace(positions="shape"))

    monkeypatch.setattr(estimates, "simulated_on", simulated)
    job: Any = SimpleNamespace(scene=SimpleNamespace(coarser=coarser), comm=MPI.COMM_SELF)
    level: Any = 0
    near: Any = ("given", "far")
    return tried, near_on_coarser(job, level, SimulatedPrint(near, None, None))


def test_the_coarsest_mesh_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    tried, found = levels_tried(monkeypatch, meshes=9)
    assert COARSER_MESHES == 2
    assert tried == [(2, ("given", "far")), (1, (2, "shape"))]
    assert found == (1, "shape")


def test_a_mesh_without_equilibrium_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    tried, found = levels_tried(monkeypatch, meshes=9, without=(2,))
    assert tried == [(2, ("given", "far")), (1, ("given", "far"))]
    assert found == (1, "shape")


def test_ratios_of_edge_lengths_multiply() -> None:
    scene: Any = SimpleNamespace(coarser=lambda level: (2.0, level + 1))
    level: Any = 0
    found: dict[float, Any] = {**coarser_levels(scene, level)}
    assert found == {2.0: 1, 4.0: 2}


@pytest.mark.parametrize("meshes", [0, 1])
def test_a_skin_may_have_fewer_meshes(monkeypatch: pytest.MonkeyPatch, meshes: int) -> None:
    tried, found = levels_tried(monkeypatch, meshes)
    assert tried == [(1, ("given", "far"))][:meshes]
    assert found == ((1, "shape") if meshes else ("given", "far"))


def mean(_: Pattern, positions: np.ndarray) -> float:
    return 1e3 * float(positions[:, 0].mean())


def found(
    monkeypatch: pytest.MonkeyPatch,
    meshes: int = 9,
    without: tuple[int, ...] = (),
    refinement: float | None = None,
) -> MetricErrors:
    """The errors of a mean, which coarser meshes, a number, tell as 10 and 40 less."""
    pattern = square(n=2)

    def coarser(level: int) -> tuple[float, int]:
        if level == meshes:
            raise ParameterError("there is no coarser mesh.")
        return 2.0, level + 1

    def simulated(_: Any, level: int, *__: Any) -> int:
        if level in without:
            raise NoEquilibriumError(f"none on mesh {level}.")
        return level

    def shape(level: int) -> np.ndarray:
        at = pattern.points - pattern.points.mean(axis=0)
        return np.asarray(at + 0.1 - 1e-3 * (10 * level**2 if level > 0 else level))

    def read(level: int, keys: list[str]) -> MeshValues:
        return estimates.values_of(pattern, shape(level), dict.fromkeys(keys, mean))

    monkeypatch.setattr(estimates, "simulated_on", simulated)
    monkeypatch.setattr(estimates, "values_at", read)
    scene = SimpleNamespace(
        coarser=coarser,
        checked=lambda level: None if refinement is None else (1 / refinement, level - 1),
    )
    job: Any = SimpleNamespace(scene=scene, comm=MPI.COMM_SELF)

    level: Any = 0
    again = SimulatedPrint((pattern, shape(0)), None, None)
    own = estimates.values_of(pattern, shape(0), {"x_mm": mean})
    return metric_errors(job, level, own, again, pattern)


def values(errors: MetricErrors) -> dict[float, float]:
    return {ratio: round(one.values["x_mm"], 9) for ratio, one in sorted(errors.found.items())}


def test_all_coarser_meshes_count(monkeypatch: pytest.MonkeyPatch) -> None:
    both = found(monkeypatch)
    assert values(both) == {1.0: 100.0, 2.0: 90.0, 4.0: 60.0}
    assert both.told["x_mm"] == pytest.approx(100.0)
    assert both.failure is None
    assert both.shape is None
    near, far = found(monkeypatch, without=(2,)), found(monkeypatch, without=(1,))
    assert (list(near.found), list(far.found)) == ([1.0, 2.0], [1.0, 4.0])
    size, edge = np.ptp(square(n=2).points, axis=0), edge_of(square(n=2).areas)
    assert near.intervals["x_mm"] == pytest.approx(half_width({2.0: 10.0}, "x_mm", size, edge))
    assert far.intervals["x_mm"] == pytest.approx(half_width({4.0: 40.0}, "x_mm", size, edge))
    assert both.intervals["x_mm"] == max(near.intervals["x_mm"], far.intervals["x_mm"])


def test_without_any_coarser_mesh_the_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    none = found(monkeypatch, without=(1, 2))
    assert none.failure == "none on mesh 1."
    assert not none.intervals
    assert values(none) == {1.0: 100.0}
    assert found(monkeypatch, meshes=0).failure == "there is no coarser mesh."


def test_values_and_intervals_of_a_finer_mesh_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """So is its shape, at the vertices of the print's mesh."""
    alone, checked = found(monkeypatch), found(monkeypatch, refinement=2.0)
    assert values(checked) == {0.5: 101.0, 1.0: 100.0, 2.0: 90.0, 4.0: 60.0}
    assert checked.told["x_mm"] == pytest.approx(101.0)
    pattern = square(n=2)
    assert mean(pattern, checked.shape) == pytest.approx(101.0)
    size, edge = np.ptp(pattern.points, axis=0), edge_of(pattern.areas)
    width = half_width({2.0: 1.0, 4.0: 11.0, 8.0: 41.0}, "x_mm", size, edge)
    assert checked.intervals["x_mm"] == pytest.approx(width)
    assert width < alone.intervals["x_mm"]
    # Where it has no equilibrium the coarser meshes tell the interval.
    failed = found(monkeypatch, refinement=2.0, without=(-1,))
    assert (failed.intervals, failed.told) == (alone.intervals, alone.told)
    single = found(monkeypatch, refinement=2.0, meshes=0)
    assert single.intervals["x_mm"] == pytest.approx(half_width({2.0: 1.0}, "x_mm", size, edge))


def test_what_is_not_known_has_no_interval() -> None:
    pattern, unknown = square(n=2), lambda *_: np.nan
    told = estimates.values_of(pattern, pattern.points, {"x_mm": mean, "lean_deg": unknown})
    assert [*told.values] == ["x_mm"]


@pytest.mark.parametrize(("ratio", "width"), [(1.5, 10.2), (0.5, 3.0 + 5.1)])
def test_a_trial_is_repeated_on_another_mesh(ratio: float, width: float) -> None:
    """Its figures have intervals, with a safety factor; what is missing on one mesh has none."""
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
    assert wider == {"stride_mm": pytest.approx(width + 1.7 * 2.0)}
    assert trial_intervals(comm, scene, told, None) == {}
    assert asked == [made, made]

    def fails() -> Any:
        raise NoEquilibriumError("none there.")

    assert trial_intervals(comm, scene, told, fails) == {}


def test_a_script_tells_intervals_of_its_print(alone: MPI.Comm, tmp_path: Path) -> None:
    """From the same case on coarser meshes; each value there lies in its interval."""
    scene = BendScene.of(angle=45.0, length=0.06, edge_length=4e-3, filter_radius=8e-3, levels=1)
    level = scene.finest_level
    problem = scene.problem(alone, scene.case(alone, level), level)
    result = tf.optimize(problem, [tf.Stage(3)], seed=1)
    printed = tf.as_printed(problem, result)
    coarser = {r: scene.case(alone, level.scaled(r)) for r in (1.5, 2.25)}
    with warnings.catch_warnings():  # of meshes that are coarse on purpose
        warnings.simplefilter("ignore")
        found = tf.print_intervals(printed, coarser)
        again = tf.print_intervals(printed, {1.5: coarser[1.5]})
    assert found.keys() >= {"angle_deg", "length_ratio", "shape_distance_percent"}
    assert found["angle_deg"] > 0.5
    assert found["angle_deg"] >= again["angle_deg"]
    made = tf.write_results(tmp_path, result, printed, intervals=found)
    figure = next(row for row in made["figures"] if row["name"] == "angle")
    assert figure["interval"] == pytest.approx(found["angle_deg"])
    assert tf.print_intervals(replace(printed, evaluation=None), coarser) == {}
    with pytest.raises(ParameterError, match=r"edges 0.5 times as long; they must be longer"):
        tf.print_intervals(printed, {0.5: coarser[1.5]})
    with pytest.raises(ParameterError, match=r"coarser\[1.5\]"):
        tf.print_intervals(printed, {1.5: problem})  # type: ignore[dict-item]
