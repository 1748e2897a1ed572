"""A skin through a sequence of pressures, and where a path stops."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers.scenes import TABLE_A
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import _predicted_motion, follow_pressures, trace
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes import Skin, cylinder, sew


def test_a_path_is_followed(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    density = np.full(len(short_tube.owned_cells), 0.3)
    points = list(trace(short_solver, density, [500.0, 1e3, 2e3]))
    alone = short_solver.solve(density, 2e3)
    assert points[-1].result.volume == pytest.approx(alone.volume, rel=1e-8)
    assert [point.result.pressure for point in points] == [500.0, 1e3, 2e3]
    begun = list(trace(short_solver, density, [2e3], start=alone.positions))
    assert begun[0].result.steps <= 1


def test_a_path_stops_at_a_point(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    density = np.zeros(len(short_tube.owned_cells))
    path = trace(
        short_solver, density, [1e2, 2e2, 3e2, 4e2], stop=lambda point: point.result.pressure > 150
    )
    assert [point.pressure for point in path] == [1e2, 2e2]


def test_increments_shrink_where_no_stable_state_is_near(
    short_tube: Skin, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver = solver_on_base(short_tube)
    finish = solver.finish
    tried: list[float] = []

    def unstable_at_first(trial: Equilibrium) -> Equilibrium:
        tried.append(trial.pressure)
        if len(tried) == 1:
            raise EquilibriumError("no stable equilibrium", replace(trial, converged=False))
        return finish(trial)

    monkeypatch.setattr(solver, "finish", unstable_at_first)
    density = np.full(len(short_tube.owned_cells), 0.3)
    points = list(trace(solver, density, [1e3, 2e3]))
    assert tried[:2] == [2e3, 1250.0]
    assert points[-1].result.pressure == 2e3


@pytest.mark.slow
def test_a_path_names_the_point_where_it_ends(alone: MPI.Comm) -> None:
    """Without a barrier in reach a tube has a limit pressure: what comes before is yielded."""
    skin = sew(alone, cylinder(alone, 0.04, 0.02, 5e-3, mesh="structured"))
    composite = Composite(fabric=TABLE_A, c1=1e5, c2=1e5, bending=None)
    solver = solver_on_base(skin, composite)
    path = trace(solver, np.zeros(len(skin.owned_cells)), [1e3, 3e3])
    assert next(path).result.pressure == 1e3
    with pytest.raises(EquilibriumError, match="the path ends between 1000 Pa and 3000 Pa, after"):
        next(path)


def test_there_are_points_where_the_skin_moves_far(
    tube: Skin, tube_solver: EquilibriumSolver
) -> None:
    density = np.full(len(tube.owned_cells), 0.3)
    begin, end = (tube_solver.solve(density, pressure) for pressure in (2e3, 3.6e3))
    model, comm = tube_solver.model, tube.comm
    moved = norm(comm, model.positions(end.state) - model.positions(begin.state))
    path = follow_pressures(tube_solver, density, [end.load], (), begin, lambda: moved / 3.5)
    found = [point.result for point in path]
    assert 4 <= len(found) <= 5
    assert found[-1].volume == pytest.approx(end.volume, rel=1e-8)
    states = [begin.state, *(one.state for one in found)]
    steps = [norm(comm, model.positions(b - a)) for a, b in pairwise(states)]
    assert max(steps) < 1.2 * moved / 3.5


def test_the_motion_is_told_before_it_is_made(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    """Where supports move, and from what is no stable state of the design, none is told."""
    density = np.full(len(tube.owned_cells), 0.3)
    begin, end = (tube_solver.solve(density, pressure) for pressure in (2e3, 2.1e3))
    model, comm = tube_solver.model, tube.comm
    moved = norm(comm, model.positions(end.state) - model.positions(begin.state))

    def told(at: Equilibrium, load: Load = end.load) -> float:
        return _predicted_motion(tube_solver, at, density, load)

    assert told(begin) == pytest.approx(moved, rel=0.05)
    shift = np.zeros(tube.pattern.points.shape)
    shift[model.supports.fixed] = 1e-4
    assert told(begin, replace(end.load, displacement=shift)) == 0
    noise = np.random.default_rng(5).standard_normal(len(begin.state)) * model.free
    assert told(replace(begin, state=begin.state + 1e-3 * noise)) == 0
    trial = tube_solver.solve(density, 2e3, trial=True)
    families = replace(begin, density=np.stack([density, density], axis=1))
    for start in (trial, families):
        assert told(start) == 0
        (point,) = follow_pressures(tube_solver, density, [end.load], (), start, lambda: 1e-9)
        assert point.result.volume == pytest.approx(end.volume, rel=1e-8)
