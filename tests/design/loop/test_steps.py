"""Densities and pressures as one vector, and the scaled functions that MMA minimises."""

import numpy as np
import pytest
from helpers.designs import bounded, full, make_problem, passive_in

from toros_fem.base.mpi import dot
from toros_fem.design.loop.fields import random_density
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.steps import Steps, Variables
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_a_vector_and_back(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    """Pressures enter as the logarithm between their bounds."""
    problem = bounded(make_problem(short_tube, short_solver), 1e3, 9e3)
    variables = Variables(problem, DesignOptions(pressure_move=0.25))
    density = random_density(short_tube, 3)
    x = variables.vector(density, (3e3,))
    if short_tube.comm.rank == 0:
        assert x[-1] == pytest.approx(0.5), "3 is the geometric mean of 1 and 9"
        assert variables.move[-1] == pytest.approx(np.log(1.25) / np.log(9))
    back, pressures = variables.design(x)
    np.testing.assert_array_equal(back, density)
    assert pressures == pytest.approx((3e3,))
    assert short_tube.comm.allreduce(len(x)) == len(short_tube.pattern.triangles) + 1


def test_prescribed_densities_have_no_range(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    passive = np.where(short_tube.owned_cells % 3 == 0, 0.25, np.nan)
    problem = passive_in(make_problem(short_tube, short_solver), passive)
    low, high = Variables(problem, DesignOptions()).bounds
    given = ~np.isnan(passive)
    np.testing.assert_array_equal(low, np.where(given, 0.25, 0.0))
    np.testing.assert_array_equal(high, np.where(given, 0.25, 1.0))


def test_scaled_functions(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    """T is 10 where a stage starts; constraints ask for half of their value, then for ε."""
    problem = full(short_tube, short_solver, beta=20.0)
    variables = Variables(problem, DesignOptions())
    base, slopes = problem.evaluate(random_density(short_tube, 3))
    stage = Stage(1, constrained=True)
    steps = Steps(problem, variables, stage, DesignOptions(), base, slopes)
    here = steps.around(base, slopes)
    assert steps.mma.state.unit == 1.0
    assert here.value + np.square(here.residuals).sum() == pytest.approx(10.0)
    far = base.length_scale > 2 * problem.length_scale.epsilon
    assert far.any()
    np.testing.assert_allclose(np.asarray(here.values)[far], 1.0)
    # The gradient of T, with that of the residuals' squares, is scaled as T is.
    count, ratio = len(slopes.gradient), 10.0 / base.objective
    rows = zip(here.residuals, here.residual_jacobian, strict=True)
    cells = here.gradient[:count] + sum(2 * r * row[:count] for r, row in rows)
    gap = cells - ratio * slopes.gradient
    assert dot(short_tube.comm, gap, gap) < 1e-20 * dot(short_tube.comm, cells, cells)
