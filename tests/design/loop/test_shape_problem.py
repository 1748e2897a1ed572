"""A skin, its pressures and its target as a design problem."""

import dataclasses

import numpy as np
import pytest
from helpers.designs import make_problem

from toros_fem.design.density.field import random_density
from toros_fem.design.loop.fields import densities_of
from toros_fem.measures.metrics import Metric, bend_angle, length_ratio
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_metrics_along_changes_of_the_density(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    metrics = (
        Metric("bend", "rad", None, lambda of, x: bend_angle(of, x, sections=6)),
        Metric("length", "ratio", None, length_ratio),
    )
    problem = dataclasses.replace(make_problem(short_tube, short_solver), metrics=metrics)
    density, fields = random_density(short_tube, 2, spread=0.3), densities_of(problem.fields)
    pattern = short_tube.pattern
    x, _, z = pattern.points[pattern.triangles[short_tube.owned_cells]].mean(axis=1).T
    changes = [0.2 * np.sign(x), 0.2 * np.sign(z - pattern.points[:, 2].mean())]
    changes = [change * problem.designed for change in changes]
    base = problem.simulate(density)
    found = problem.metric_derivatives(base, changes)
    state, step = base.equilibrium.state, 1e-3
    for k, change in enumerate(changes):
        slope = fields.projection.backward(base.filtered, problem.designed.astype(float))
        rate = problem.metric_derivatives(base, [slope * fields.filter.forward(change)])
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
