"""A skin whose line families are designed: gradients through the whole chain, and ranks."""

import numpy as np
import pytest
from helpers.designs import bounded, make_problem

from toros_fem.base.errors import ParameterError
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.design.relaxed.problem import FixedDirections, FreeDirections, relaxed_problem
from toros_fem.mechanics.equilibrium.continuation import NewtonStep
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def made(
    skin: Skin, solver: EquilibriumSolver, families: FixedDirections | FreeDirections
) -> ShapeProblem:
    return relaxed_problem(bounded(make_problem(skin, solver), 1e3, 2e4), families, 0.015, 0.3)


def variables(skin: Skin, families: FixedDirections | FreeDirections, seed: int) -> np.ndarray:
    drawn = np.random.default_rng(seed).uniform(0, 1, (len(skin.pattern.panel), families.fields))
    return drawn[skin.owned_cells].ravel()


def test_factor_of_crossings_reaches_the_model(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    families, design = FixedDirections(4, 0.3), make_problem(short_tube, short_solver)
    moduli = []
    for crossing in (0.0, 0.2, 0.4):
        problem = relaxed_problem(design, families, 0.015, crossing=crossing)
        found = problem.simulate(problem.fields.with_passive(variables(short_tube, families, 0)))
        problem.solver.model.set_density(found.projected)
        moduli.append(problem.solver.model.mean_modulus())
    none, some, twice = moduli
    assert twice - none == pytest.approx(2 * (some - none), rel=1e-9)
    assert some > 1.0001 * none


def test_where_nothing_is_designed_there_are_no_lines(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    problem = made(short_tube, short_solver, FixedDirections(4, 0.3))
    _, material = problem.fields.forward(problem.fields.start(3))
    given = ~problem.designed
    assert np.all(material[given, 0] == 1)
    assert not material[given, 1:5].any()
    assert np.all(material[~given, 0] == 0)
    assert np.all(material[~given, 1:5] > 0)
    low, high = problem.fields.bounds
    assert not low.any()
    assert np.array_equal(high.reshape(-1, 4), np.repeat(problem.designed[:, None], 4, axis=1))


def test_newton_steps_are_logged_as_those_of_the_design(
    short_tube: Skin, short_solver: EquilibriumSolver, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows: list[NewtonStep] = []
    monkeypatch.setattr(short_solver, "log", rows.append)
    problem = made(short_tube, short_solver, FixedDirections(4, 0.3))
    found = problem.simulate(problem.fields.start(3))
    assert tuple(rows) == found.equilibrium.history


def test_variables_are_checked(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    problem = made(short_tube, short_solver, FixedDirections(4, 0.3))
    count = len(problem.designed)
    with pytest.raises(ParameterError, match="4 of each owned triangle"):
        problem.simulate(np.zeros(count))
    with pytest.raises(ParameterError, match=r"leaves \[0, 1\]"):
        problem.simulate(np.full(4 * count, -0.1))
