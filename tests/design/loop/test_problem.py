"""One evaluation of a design: parts, trials, prescribed densities."""

import numpy as np
import pytest
from helpers.designs import full, make_problem
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem.base.mpi import norm
from toros_fem.design.loop.fields import random_density
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_a_completed_trial_has_the_exact_gradient(
    short_tube: Skin, alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Trials with inexact Newton steps, completed, then differentiated."""
    monkeypatch.setattr("toros_fem.mechanics.equilibrium.iteration.KRYLOV_COST", 0.3)
    solver = solver_on_base(short_tube)
    problem = full(short_tube, solver).changed(terms=())
    density = random_density(short_tube, 2, spread=0.3)
    start = problem.simulate(random_density(short_tube, 2, spread=0.25)).equilibrium.state
    trial = problem.simulate(density, start, 4e3, trial=True)
    assert any(row.kind == "cg" for row in trial.equilibrium.history)
    base = problem.finish(trial)
    slopes = problem.differentiate(base)
    exact = make_problem(short_tube, solver_on_base(short_tube))
    direct, expected = exact.evaluate(density, pressure=4e3)
    assert base.objective == pytest.approx(direct.objective, rel=1e-9)
    gap = norm(alone, slopes.gradient - expected.gradient)
    assert gap < 1e-7 * norm(alone, expected.gradient)


def test_binary_pattern_is_simulated_as_it_is(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    problem = make_problem(short_tube, short_solver)
    design = problem.simulate(random_density(short_tube, 3, spread=0.5))
    printed = design.filtered > 0.5
    binary = problem.simulate_binary(printed, design)
    assert set(np.unique(binary.projected)) <= {0.0, 1.0}
    assert np.array_equal(binary.projected[problem.designed] > 0.5, printed[problem.designed])
    assert np.all(binary.projected[~problem.designed] == 1)
    assert binary.equilibrium.pressure == design.equilibrium.pressure
    assert binary.shape != design.shape
    again = problem.simulate_binary(printed, design, start=binary.equilibrium.state)
    assert again.equilibrium.steps < binary.equilibrium.steps, "it starts at the equilibrium"
    assert again.shape == pytest.approx(binary.shape, rel=1e-6)


def test_gradient_of_an_earlier_design(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    """Its tangent is factorised again."""
    problem = make_problem(short_tube, short_solver)
    first = problem.simulate(random_density(short_tube, 0))
    gradient = problem.differentiate(first).gradient
    problem.simulate(random_density(short_tube, 1))
    assert problem.differentiate(first).gradient == pytest.approx(gradient, rel=1e-6, abs=1e-12)
