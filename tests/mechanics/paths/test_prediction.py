"""Where the next equilibrium of a path is expected."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import norm
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.prediction import Prediction, _hermite
from toros_fem.mechanics.paths.trace import follow_pressures
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes import Skin

PRESSURES = (2e3, 2.4e3, 2.8e3, 3.2e3)


@pytest.fixture(scope="module")
def density(tube: Skin) -> Floats:
    return np.full(len(tube.owned_cells), 0.3)


@pytest.fixture(scope="module")
def path(tube_solver: EquilibriumSolver, density: Floats) -> Sequence[Equilibrium]:
    points = follow_pressures(tube_solver, density, [*PRESSURES, 3.6e3], (), None)
    return [point.result for point in points]


def predicted(
    solver: EquilibriumSolver, points: Sequence[Equilibrium], load: Load
) -> tuple[Prediction, Equilibrium]:
    prediction = Prediction(solver, points[0])
    for point in points[1:]:
        prediction.start(point.density, point.load)  # as a path does
        prediction.add(point)
    return prediction, prediction.start(points[-1].density, load)


def left(solver: EquilibriumSolver, start: Equilibrium, end: Equilibrium, of: Equilibrium) -> float:
    """Return the part of the motion from `of` to the end that a start leaves."""
    comm = solver.skin.comm
    return norm(comm, start.state - end.state) / norm(comm, of.state - end.state)


def test_more_points_predict_better(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    """One point has its tangent; a cubic passes through two with tangents, a quintic through three.

    A point that is no equilibrium of this solver has no tangent.
    """
    *before, end = path

    def part(points: Sequence[Equilibrium]) -> float:
        start = predicted(tube_solver, points, end.load)[1]
        return left(tube_solver, start, end, before[-1])

    parts = [part(before[-k:]) for k in (1, 2, 3)]
    assert parts[0] < 0.15
    assert parts[1] < parts[0] / 5
    assert parts[2] < parts[1] / 5
    trial = replace(before[-2], complete=False)
    assert parts[1] < part([trial, before[-1]]) < parts[0]


def test_where_a_path_comes_from_knows_where_it_leads(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    *before, end = path
    _, start = predicted(tube_solver, before, end.load)
    assert start.before is not None
    wanted = tube_solver.motion_to(end.density, end.load, before[-1])
    np.testing.assert_allclose(start.before.motion, wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("sloped", [(True, True), (False, True, True), (False, True)])
def test_a_polynomial_is_predicted_exactly(sloped: Sequence[bool]) -> None:
    places = (-1.7, -0.6, 0.0)[-len(sloped) :]
    count = len(sloped) + sum(sloped)
    of = np.polynomial.Polynomial(np.random.default_rng(3).standard_normal(count))
    values, slopes = _hermite(places, sloped)
    at = [place for place, one in zip(places, sloped, strict=True) if one]
    found = values @ of(np.array(places)) + slopes @ of.deriv()(np.array(at))
    assert found == pytest.approx(of(1.0), rel=1e-10)


def test_the_motion_is_told_before_it_is_made(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    *before, end = path
    model, comm = tube_solver.model, tube_solver.skin.comm
    prediction, _ = predicted(tube_solver, before, end.load)
    moved = norm(comm, model.positions(end.state) - model.positions(before[-1].state))
    assert prediction.motion(end.density, end.load) == pytest.approx(moved, rel=0.01)


def test_a_jump_and_another_design_begin_anew(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    *before, last, end = path
    whole, _ = predicted(tube_solver, [*before, last], end.load)
    alone, _ = predicted(tube_solver, [last], end.load)
    jumped = replace(last, condition=replace(last.condition, snapped=True))
    other = [replace(point, density=point.density + 0.1) for point in before]
    found = alone.motion(last.density, end.load)
    assert found != whole.motion(last.density, end.load)
    for points in ([*before, jumped], [*other, last]):
        prediction, _ = predicted(tube_solver, points, end.load)
        assert prediction.motion(last.density, end.load) == pytest.approx(found, rel=1e-9)


def test_loads_off_the_line_do_not_count(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    """A polynomial of the pressure tells nothing of a force."""
    last = path[-2]
    force = np.zeros(tube_solver.skin.pattern.points.shape)
    force[:, 0] = 1e-4
    load = replace(last.load, force=force)
    prediction, _ = predicted(tube_solver, path[:-1], load)
    alone, _ = predicted(tube_solver, [last], load)
    assert prediction.motion(last.density, load) == alone.motion(last.density, load) > 0


def test_the_tangent_to_another_force_is_not_that_of_a_pressure(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    """The path comes from a load without the force, and goes on by pressure alone."""
    before, density = path[0], path[0].density
    force = np.zeros(tube_solver.skin.pattern.points.shape)
    force[:, 0] = 1e-4
    here, there = (replace(path[k].load, force=force) for k in (1, 2))
    found = tube_solver.solve(density, here, before)
    _, start = predicted(tube_solver, [before, found], there)
    wanted = tube_solver.motion_to(density, there, found)
    assert start.before is not None
    np.testing.assert_allclose(start.before.motion, wanted, atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_allclose(start.state - found.state, wanted, atol=1e-9 * np.abs(wanted).max())


def test_what_is_no_start_is_not_taken(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    """Far away a prediction leaves the stretch bounds; where supports move there is none."""
    points, last = path[:-1], path[-2]
    far = replace(last.load, pressure=100 * np.asarray(last.load.pressure))
    assert predicted(tube_solver, points, far)[1] is last
    moved = np.zeros(tube_solver.skin.pattern.points.shape)
    moved[tube_solver.model.supports.fixed] = 1e-4
    carried = replace(last.load, displacement=moved)
    prediction, start = predicted(tube_solver, points, carried)
    assert start is last
    assert prediction.motion(last.density, carried) == 0


def test_a_path_may_begin_where_there_is_no_tangent(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    """A trial, a state that is not stable, and a design of line families are starts as others."""
    first, second = path[:2]
    trial = tube_solver.solve(first.density, first.load, trial=True)
    noise = np.random.default_rng(5).standard_normal(len(first.state))
    away = replace(first, state=first.state + 1e-3 * noise * tube_solver.model.free)
    families = replace(first, density=np.stack([first.density, first.density], axis=1))
    assert predicted(tube_solver, [trial], second.load)[1] is trial
    assert predicted(tube_solver, [away], second.load)[1] is away
    for start in (trial, families):
        (point,) = follow_pressures(tube_solver, first.density, [second.load], (), start)
        assert point.result.volume == pytest.approx(second.volume, rel=1e-8)


def test_there_are_points_where_the_skin_moves_far(
    tube_solver: EquilibriumSolver, path: Sequence[Equilibrium]
) -> None:
    begin, end = path[0], path[-1]
    model, comm = tube_solver.model, tube_solver.skin.comm
    moved = norm(comm, model.positions(end.state) - model.positions(begin.state))
    found = [
        point.result
        for point in follow_pressures(
            tube_solver, begin.density, [end.load], (), begin, lambda: moved / 3.5
        )
    ]
    assert 4 <= len(found) <= 5
    assert found[-1].volume == pytest.approx(end.volume, rel=1e-8)
    states = [begin.state, *(one.state for one in found)]
    steps = [norm(comm, model.positions(b - a)) for a, b in pairwise(states)]
    assert max(steps) < 1.2 * moved / 3.5
