"""A skin, its pressures and its target as a design problem."""

import dataclasses

import numpy as np
import pytest
from helpers.designs import make_problem

from toros_fem import errors
from toros_fem.design.density.field import random_density
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.measures.metrics import Metric, bend_angle, length_ratio
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_metrics_along_changes_of_the_density(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    metrics = (
        Metric("bend", "rad", None, lambda of, x: bend_angle(of, x, sections=6)),
        Metric("length", "ratio", None, length_ratio),
    )
    problem = dataclasses.replace(make_problem(tube, tube_solver), metrics=metrics)
    density = random_density(tube, 2, spread=0.3)
    pattern = tube.pattern
    x, _, z = pattern.points[pattern.triangles[tube.owned_cells]].mean(axis=1).T
    changes = [0.2 * np.sign(x), 0.2 * np.sign(z - pattern.points[:, 2].mean())]
    changes = [change * problem.designed for change in changes]
    base = problem.simulate(density)
    found = problem.metric_derivatives(base, changes)
    state, step = base.equilibrium.state, 1e-3
    for k, change in enumerate(changes):
        slope = problem.projection.backward(base.filtered, problem.designed.astype(float))
        rate = problem.metric_derivatives(base, [slope * problem.filter.forward(change)])
        there, back = (
            problem.metrics_of(problem.simulate(density + s * change, state).equilibrium)
            for s in (step, -step)
        )
        base = problem.simulate(density, state)
        for key in ("bend_rad", "length_ratio"):
            assert rate[key][0] == pytest.approx((there[key] - back[key]) / (2 * step), rel=1e-3)
            assert abs(found[key][k]) > 0
    again = problem.metric_derivatives(base, [sum(changes)])
    for key, values in found.items():
        assert again[key][0] == pytest.approx(values.sum(), rel=1e-5)


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
