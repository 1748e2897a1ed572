"""The curve of a print's metrics over the pressure: where it begins, passes and ends."""

import csv
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.designs import make_problem
from helpers.scenes import TABLE_A
from helpers.standing import solver_on_base
from helpers.surfaces import sphere
from mpi4py import MPI
from shapely import Polygon

from toros_fem.base.validation import Bools
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.materials.sheet import Bending, Composite, Material
from toros_fem.measures.metrics import Measurement, Metric, bend_angle
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.meshes import Skin, cylinder, moulded, sew
from toros_fem.products.actuators.pressure import (
    HALVINGS,
    PARTS,
    CurveFigures,
    trace_pressure_curve,
    write_curve,
)
from toros_fem.products.common.tables import ResultTable
from toros_fem.results.runs.frames import read_frames

ANGLE = Metric("angle", "deg", 60.0, lambda of, x: float(np.degrees(bend_angle(of, x, sections=5))))
Print = Evaluation[Equilibrium]
Curve = tuple[list[TracePoint], CurveFigures]


def inner_side(skin: Skin) -> Bools:
    """A print along half of the tube, at x > 0: it keeps its length, so the tube bends there."""
    pattern = skin.pattern
    x = pattern.points[pattern.triangles].mean(axis=1)[:, 0]
    return np.asarray((x > 0)[skin.owned_cells])


@pytest.fixture(scope="module")
def tube(alone: MPI.Comm) -> Skin:
    return sew(alone, cylinder(alone, 0.06, 0.02, 6e-3))


@pytest.fixture(scope="module")
def problem(tube: Skin) -> ShapeProblem:
    solver = solver_on_base(tube)
    return replace(make_problem(tube, solver), metrics=(ANGLE,))


@pytest.fixture(scope="module")
def made(problem: ShapeProblem) -> Print:
    return problem.simulate_binary(inner_side(problem.skin), pressure=3e3)


@pytest.fixture(scope="module")
def curve(problem: ShapeProblem, made: Print) -> Curve:
    return trace_pressure_curve(problem, made, 8e3, 4, [7e3, 4e3, 9e3])


def test_a_curve_passes_through_the_print(problem: ShapeProblem, made: Print, curve: Curve) -> None:
    (at,) = [point for point in curve[0] if point.result.pressure == 3e3]
    assert at.result is made.equilibrium
    assert at.metrics == problem.metrics_of(made.equilibrium)
    above = [p.result.pressure for p in curve[0] if p.result.pressure > 1.5e3]
    assert {2e3, 3e3, 4e3, 6e3, 7e3, 8e3} <= {round(pressure, 6) for pressure in above}
    assert curve[1].failure_above is curve[1].failure_below is None


def test_volume_and_bend_rise_with_the_pressure(curve: Curve) -> None:
    """The volume as the energy has it at every stable equilibrium, the bend of this print too."""
    assert np.diff([point.result.pressure for point in curve[0]]).min() > 0
    assert np.diff([point.result.volume for point in curve[0]]).min() > 0
    assert np.diff([point.metrics["angle_deg"] for point in curve[0]]).min() > 0


def test_points_are_dense_where_the_skin_moves_fast(problem: ShapeProblem, curve: Curve) -> None:
    """A film is smooth then, and a curve is no polygon."""
    shapes = [problem.skin.pattern.points, *(point.positions for point in curve[0])]
    moves = np.array([np.linalg.norm(b - a) for a, b in pairwise(shapes)])
    assert moves[1:].max() < 1.05 / PARTS * moves.sum()
    # Above the print, a part of the way is one of a way that grows.
    (printed,) = (k for k, point in enumerate(curve[0]) if point.result.pressure == 3e3)
    growth = np.log(moves.sum() / moves[: printed + 1].sum())
    assert len(curve[0]) < 8 + HALVINGS + PARTS * (1 + growth)


def test_a_curve_begins_where_the_skin_is_filled(
    problem: ShapeProblem, made: Print, curve: Curve
) -> None:
    """Below, the flat print unrolls; the last step down finds where this begins."""
    model = problem.solver.model
    assembled = sum(model.volumes(model.assembled))
    first, unfilled_at = curve[0][0].result, curve[1].unfilled_at_pa
    assert first.volume >= assembled
    assert first.pressure / 2 <= unfilled_at < first.pressure
    empty = problem.solver.solve(made.projected, unfilled_at, start=first.state)
    assert empty.volume < assembled


def test_a_shape_that_inflating_does_not_reach_is_told(alone: MPI.Comm, curve: Curve) -> None:
    """A spherical shell keeps a dent up to some pressure; from rest it has none."""
    assert curve[1].joins_rest is True
    ball = sphere(2)
    panel = (ball.points[ball.triangles].mean(axis=1)[:, 2] > -3e-3).astype(np.int64)
    skin = sew(alone, moulded(ball.points, ball.triangles, panel, ("base", "top")))
    sheet = Material(1e6, 0.3, 0.2e-3)
    solver = solver_on_base(skin, Composite(sheet, sheet, bending=Bending(rest="assembled")))
    start, density = skin.pattern.points[skin.owned_vertices], np.ones(len(skin.owned_cells))
    start[:, 2] = np.minimum(start[:, 2], 8e-3 - start[:, 2])
    problem = SimpleNamespace(comm=alone, solver=solver, skin=skin, metrics=())
    for begin, joins in ((None, True), (start, False)):
        made = SimpleNamespace(equilibrium=solver.solve(density, 30.0, begin), projected=density)
        _, found = trace_pressure_curve(problem, made, 40.0, 2)  # type: ignore[arg-type]
        assert found.joins_rest is joins


def test_chambers_keep_the_ratios_of_their_pressures(tube: Skin) -> None:
    """Of a print at more than the largest pressure the curve leads down alone."""
    upper = tube.pattern.points[tube.pattern.triangles].mean(axis=1)[:, 2] > 0.03
    chambers = Chambers(("low", "high"), upper.astype(int))
    solver = solver_on_base(tube, chambers=chambers)
    problem = replace(make_problem(tube, solver), metrics=(ANGLE,))
    made = problem.simulate_binary(inner_side(tube), pressure=(1e3, 2e3))
    points, _ = trace_pressure_curve(problem, made, 1e3, 1)
    pressures = np.array([point.result.pressures for point in points])
    assert pressures[-1].tolist() == [1e3, 2e3]
    assert [500.0, 1e3] in pressures.tolist()
    assert pressures[:, 1] == pytest.approx(2 * pressures[:, 0])


def printed_as(made: Print | None) -> Any:
    return SimpleNamespace(
        evaluation=made, regions=[Polygon()] * 3, failure="" if made else "It fails."
    )


CONFIG = ResultTable(curve_pressure=4e3, curve_steps=2)


@pytest.mark.slow
def test_files_and_figures(tmp_path: Path, problem: ShapeProblem, made: Print) -> None:
    measured = [
        Measurement("angle_deg", 60.0, 3.5e3, 40.0, "a bench"),
        Measurement("angle_deg", 60.0, 9e3, 50.0, "another"),
        Measurement("angle_deg", 90.0, 4e3, 70.0, "of another target"),
    ]
    entry = write_curve(problem.comm, tmp_path, printed_as(made), CONFIG, measured)
    with (tmp_path / "curve.csv").open(encoding="utf-8") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    assert list(rows[0]) == ["pressure_pa", "volume_m3", "stretch_use", "angle_deg"]
    at = {round(row["pressure_pa"], 6): row["angle_deg"] for row in rows}
    assert {2e3, 3e3, 3.5e3, 4e3} <= set(at)
    assert at[3e3] == problem.metrics_of(made.equilibrium)["angle_deg"]
    assert (entry.points, entry.highest_pa) == (len(rows), 4e3)
    assert entry.lowest_pa == rows[0]["pressure_pa"] > entry.unfilled_at_pa
    found = [(m["measured"], m["simulated"]) for m in entry.measured]
    assert found == [(40.0, at[3.5e3]), (50.0, None)]
    frames = read_frames(tmp_path / "frames", "pressure")
    assert [frame.values["pressure_pa"] for frame in frames] == [row["pressure_pa"] for row in rows]


def test_left_out_or_without_a_print(tmp_path: Path, problem: ShapeProblem, made: Print) -> None:
    folder = tmp_path / "none"
    off = CONFIG.updated(curve_pressure=None)
    assert write_curve(problem.comm, folder, printed_as(made), off) is None
    failed = write_curve(problem.comm, folder, printed_as(None), CONFIG)
    assert failed == CurveFigures("It fails.")
    assert not folder.exists()


@pytest.mark.slow
def test_a_curve_ends_where_there_is_no_equilibrium(alone: MPI.Comm, tmp_path: Path) -> None:
    """Without a barrier in reach a tube has a limit pressure, and files and figures say so."""
    skin = sew(alone, cylinder(alone, 0.04, 0.02, 4e-3, mesh="structured"))
    composite = Composite(fabric=TABLE_A, c1=1e5, c2=1e5, bending=None)
    solver = solver_on_base(skin, composite)
    problem = replace(make_problem(skin, solver), metrics=(ANGLE,))
    made = problem.simulate_binary(np.zeros(len(skin.owned_cells)), pressure=1e3)
    config = CONFIG.updated(curve_pressure=6e3)
    entry = write_curve(problem.comm, tmp_path, printed_as(made), config)
    ended = re.match(
        r"the path ends between (\S+) Pa and (\S+) Pa, after", str(entry.failure_above)
    )
    assert 2e3 < float(ended[1]) < float(ended[2]) <= 3e3
    assert entry.failure_below is None
    assert entry.highest_pa == pytest.approx(float(ended[1]), rel=1e-5)
    assert (tmp_path / "curve.csv").exists()
