"""A skin, its pressures and its target as a design problem."""

import dataclasses

import pytest
from helpers.designs import full, make_problem

from toros_fem import errors
from toros_fem.density.field import random_density
from toros_fem.design.loop import optimize
from toros_fem.design.options import DesignOptions, Stage
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_pressure_gradient_alone(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    problem = full(tube, tube_solver)
    density = random_density(tube, 2, spread=0.3)
    base = problem.evaluate(density, pressure=3e3)
    assert base.equilibrium.pressure == 3e3
    state = base.equilibrium.state
    there, back = (problem.simulate(density, state, 3e3 + s).objective for s in (1.0, -1.0))
    assert base.pressure_gradient == pytest.approx((there - back) / 2, rel=1e-4)


def test_bad_pressure_bounds(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    problem = make_problem(tube, tube_solver)
    with pytest.raises(errors.ParameterError, match=r"pressure = 5000.0 .* between 6000"):
        dataclasses.replace(problem, pressure_bounds=(6e3, 2e4))
    with pytest.raises(errors.ParameterError, match="leave it no room"):
        dataclasses.replace(problem, pressure_bounds=(5e3, 5e3))
    constrained = DesignOptions((Stage(1, constrained=True),))
    with pytest.raises(errors.ParameterError, match="problem has no length_scale"):
        optimize(make_problem(tube, tube_solver), constrained, start=random_density(tube, 0))
    with pytest.raises(errors.ParameterError, match="iterations = 2.5"):
        Stage(2.5)  # type: ignore[arg-type]
    with pytest.raises(errors.ParameterError, match="retries = -1"):
        DesignOptions(retries=-1)
    with pytest.raises(errors.ParameterError, match="least_pressure = 0"):
        dataclasses.replace(problem, pressure_bounds=(0.0, 2e4))
