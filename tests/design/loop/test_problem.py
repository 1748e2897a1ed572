"""One evaluation of a design: parts, trials, prescribed densities."""

import dataclasses

import numpy as np
import pytest
from helpers.designs import full, make_problem
from kit.slopes import slope
from mpi4py import MPI

from toros_fem import errors
from toros_fem.base.mpi import norm
from toros_fem.design.density.field import random_density
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Skin


def test_gradients_by_density_and_pressure(
    tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm
) -> None:
    """T with its perimeter term, and both constraints; given triangles have no gradient."""
    problem = full(tube, tube_solver)
    density = random_density(tube, 2, spread=0.3)
    base = problem.evaluate(density)
    assert base.gradient is not None
    assert base.pressure_gradient is not None
    assert base.length_scale_gradients is not None
    way = 1e-3 * np.random.default_rng(9).uniform(-1, 1, len(tube.pattern.panel))[tube.owned_cells]

    def values(density: np.ndarray, pressure: float) -> np.ndarray:
        there = problem.simulate(density, base.equilibrium.state, pressure)
        assert there.length_scale is not None
        return np.array([there.objective, *there.length_scale])

    found = [comm.allreduce(g @ way) for g in (base.gradient, *base.length_scale_gradients)]
    rise = slope(lambda h: values(density + h * way, 5e3))
    assert found == pytest.approx(rise, rel=1e-5)
    rise = slope(lambda h: values(density, 5e3 + 5 * h)) / 5
    assert base.pressure_gradient[0] == pytest.approx(rise[0], rel=1e-5)


def test_gradient_on_the_way_of_the_loop(
    tube: Skin, comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Trials with inexact Newton steps, completed, then differentiated: the gradient is exact."""
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.newton.CG_COST", 0.3)
    solver = EquilibriumSolver(tube, Composite(), clamp(tube.pattern, ["base"]))
    problem = dataclasses.replace(full(tube, solver), perimeter=None, perimeter_weight=None)
    density = random_density(tube, 2, spread=0.3)
    start = problem.evaluate(random_density(tube, 2, spread=0.25)).equilibrium.state
    trial = problem.simulate(density, start, 4e3, trial=True)
    assert any(row.inexact for row in trial.equilibrium.history)
    base = problem.differentiate(problem.finish(trial))
    exact = make_problem(tube, EquilibriumSolver(tube, Composite(), clamp(tube.pattern, ["base"])))
    direct = exact.evaluate(density, pressure=4e3)
    assert base.objective == pytest.approx(direct.objective, rel=1e-9)
    assert base.gradient is not None
    assert direct.gradient is not None
    gap = norm(comm, base.gradient - direct.gradient)
    assert gap < 1e-7 * norm(comm, direct.gradient)


def test_a_completed_trial_has_the_exact_gradient(
    tube: Skin, comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Trials with inexact Newton steps, completed, then differentiated."""
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.newton.CG_COST", 0.3)
    solver = EquilibriumSolver(tube, Composite(), clamp(tube.pattern, ["base"]))
    problem = dataclasses.replace(full(tube, solver), perimeter=None, perimeter_weight=None)
    density = random_density(tube, 2, spread=0.3)
    start = problem.evaluate(random_density(tube, 2, spread=0.25)).equilibrium.state
    trial = problem.simulate(density, start, 4e3, trial=True)
    assert any(row.inexact for row in trial.equilibrium.history)
    base = problem.differentiate(problem.finish(trial))
    exact = make_problem(tube, EquilibriumSolver(tube, Composite(), clamp(tube.pattern, ["base"])))
    direct = exact.evaluate(density, pressure=4e3)
    assert base.objective == pytest.approx(direct.objective, rel=1e-9)
    assert base.gradient is not None
    assert direct.gradient is not None
    gap = norm(comm, base.gradient - direct.gradient)
    assert gap < 1e-7 * norm(comm, direct.gradient)


def test_what_is_not_asked_for_is_not_there(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    plain = make_problem(tube, tube_solver).evaluate(random_density(tube, 0))
    assert plain.perimeter is None
    assert plain.length_scale is None
    assert plain.pressure_gradient is None
    assert plain.objective == plain.shape
    unweighted = dataclasses.replace(full(tube, tube_solver), perimeter=None, perimeter_weight=None)
    assert unweighted.simulate(random_density(tube, 0)).perimeter is None
    with_it = full(tube, tube_solver).simulate(random_density(tube, 0))
    assert with_it.perimeter is not None
    size = tube.pattern.size
    expected = with_it.shape + 1e-4 * with_it.perimeter / size
    assert with_it.objective == pytest.approx(expected, rel=1e-14)


def test_binary_pattern_is_simulated_as_it_is(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    problem = make_problem(tube, tube_solver)
    design = problem.simulate(random_density(tube, 3, spread=0.5))
    printed = design.filtered > 0.5
    binary = problem.simulate_binary(printed, design)
    assert set(np.unique(binary.projected)) <= {0.0, 1.0}
    assert np.array_equal(binary.projected[problem.designed] > 0.5, printed[problem.designed])
    assert np.all(binary.projected[~problem.designed] == 1)
    assert binary.equilibrium.pressure == design.equilibrium.pressure
    assert binary.shape != design.shape


def test_gradient_of_a_state_that_is_gone(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    problem = make_problem(tube, tube_solver)
    first = problem.simulate(random_density(tube, 0))
    problem.simulate(random_density(tube, 1))
    with pytest.raises(errors.ParameterError, match="another state"):
        problem.differentiate(first)


def test_bad_densities(tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm) -> None:
    problem = make_problem(tube, tube_solver)
    density = random_density(tube, 0)
    short = density[:-1] if comm.rank == comm.size - 1 else density
    with pytest.raises(errors.DensityError, match="shape"):
        optimize(problem, DesignOptions((Stage(1),)), start=short)
    with pytest.raises(errors.DensityError, match="passive has shape"):
        dataclasses.replace(problem, passive=short)
    with pytest.raises(errors.DensityError, match="none is designed"):
        dataclasses.replace(problem, passive=np.ones_like(density))
    with pytest.raises(errors.DensityError, match="from 2.0 to 2.0"):
        dataclasses.replace(problem, passive=np.where(density > 0.5, np.nan, 2.0))
