"""A skin whose line families are designed: gradients through the whole chain, and ranks."""

import numpy as np
import pytest
from helpers.designs import bounded, make_problem

from toros_fem.base.errors import ParameterError
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.design.relaxed.problem import FixedDirections, FreeDirections, relaxed_problem
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_sum_of_fixed_shares_stays_below_its_limit() -> None:
    families = FixedDirections(12, 0.35)
    shares = families.forward(np.ones((1, 12)))[:, 1:13]
    assert 0.99 * 0.35 < shares.sum() < 0.35
    few = families.forward(np.full((1, 12), 1e-3))[:, 1:13]
    assert few == pytest.approx(0.35e-3, rel=1e-6)


def test_free_directions_return_what_they_were_given() -> None:
    families = FreeDirections()
    shares, angles = np.array([[0.1, 0.02]]), np.array([[0.3, 2.0]])
    material = families.forward(families.variables(shares, angles))
    assert material[0, 0] == 0
    assert material[0, 1:3] == pytest.approx(shares[0])
    assert np.arctan2(material[0, 5:], material[0, 3:5]) / 2 % np.pi == pytest.approx(angles[0])


@pytest.mark.parametrize("turn", [0.3, -1.2, 3.0])
def test_a_turned_chart_turns_the_lines(turn: float) -> None:
    free = FreeDirections()
    x = free.variables(np.array([[0.1, 0.2]]), np.array([[0.4, 1.1]]))[0]
    there = free.centre + free.transport(turn) @ (x - free.centre)
    material = free.forward(there[None])[0]
    assert np.exp(1j * np.arctan2(material[5:], material[3:5])) == pytest.approx(
        np.exp(2j * (np.array([0.4, 1.1]) + turn))
    )
    fixed = FixedDirections(12)
    shares = np.zeros(12)
    shares[3] = 1.0
    turned = fixed.transport(turn) @ shares
    assert turned.sum() == pytest.approx(1)
    assert turned.min() >= 0
    mean = np.angle(turned @ np.exp(2j * fixed.angles))
    # A direction is shared out between its two neighbours: a few hundredths of a step off.
    assert np.exp(1j * mean) == pytest.approx(np.exp(2j * (fixed.angles[3] + turn)), abs=0.01)


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
