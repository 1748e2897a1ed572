"""Robust designs: eroded and dilated patterns of the same filtered density."""

import dataclasses

import numpy as np
import pytest
from helpers.designs import RADIUS, full, make_problem
from helpers.loops import OneEntry, Stopped, figures
from kit.slopes import slope

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.robust import Variants, WidthTolerance
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Skin


def solver(tube: Skin) -> EquilibriumSolver:
    return EquilibriumSolver(tube, Composite(bending=None), clamp(tube.pattern, ["base"]))


def robust(tube: Skin, weight: float = 1e4) -> ShapeProblem:
    plain = full(tube, solver(tube))
    tolerance = WidthTolerance(0.2 * RADIUS, weight)
    made = Variants(tolerance, plain.filter, plain.projection.eta, lambda: solver(tube))
    return dataclasses.replace(plain, robust=made)


@pytest.mark.parametrize("told", [False, True])
def test_gradient(tube: Skin, *, told: bool) -> None:
    """By densities and by the pressure, where the spread makes up most of T.

    Also where the spread of a print is known.
    """
    problem, pattern = robust(tube, 1e5), tube.pattern
    along = pattern.points[pattern.triangles].mean(axis=1)[tube.owned_cells, 2]
    density = 0.5 + 0.3 * np.sin(2 * np.pi * along / 0.03)
    if told:
        before = problem.simulate(density)
        printed = 0.3 * (before.equilibrium.positions - pattern.points[tube.owned_vertices])
        problem = problem.with_printed_spread(printed, before)
        x, forward = before.equilibrium.positions, problem.objective.forward
        expected = (forward(x + printed) + forward(x - printed)) / 2 - forward(x)
        assert problem.simulate(density).spread == pytest.approx(expected, rel=1e-6)
    here = problem.evaluate(density)
    assert here.spread is not None
    assert 1e5 * here.spread > here.shape
    assert here.gradient is not None
    assert here.pressure_gradient is not None
    assert here.steps > here.equilibrium.steps
    drawn = np.random.default_rng(1).uniform(-1, 1, len(pattern.triangles))
    way = drawn[tube.owned_cells] * problem.designed
    along = dot(tube.comm, here.gradient, way) + 5e3 * here.pressure_gradient[0]

    def value(h: float) -> float:
        start = here.equilibrium.state
        return problem.simulate(density + h * way, start, 5e3 * (1 + h)).objective

    rise = slope(lambda h: value(1e-3 * h)) / 1e-3
    assert along == pytest.approx(rise, rel=1e-6)


def test_without_variants_nothing_differs(tube: Skin) -> None:
    """Stages that are not robust are those of the plain problem to the last bit."""
    plain = optimize(full(tube, solver(tube)), [Stage(3)], seed=3)
    off = optimize(robust(tube), [Stage(3, robust=False)], seed=3)
    assert [figures(r) for r in off.history] == [figures(r) for r in plain.history]
    assert np.array_equal(off.density, plain.density)
    assert not off.final.variants


def test_a_stopped_design_goes_on_bit_for_bit(tube: Skin) -> None:
    options = DesignOptions((Stage(3),))
    whole = optimize(robust(tube), options, seed=3)
    stopping = OneEntry(stop_at=2)
    with pytest.raises(Stopped):
        optimize(robust(tube), options, seed=3, journal=stopping)
    again = optimize(robust(tube), options, seed=3, journal=OneEntry(saved=stopping.kept))
    assert [figures(r) for r in again.history] == [figures(r) for r in whole.history]
    for one, two in zip(again.final.variants, whole.final.variants, strict=True):
        assert np.array_equal(one.state, two.state)


def test_the_spread_falls(tube: Skin) -> None:
    """Plain steps, and as many robust ones from there."""
    problem = robust(tube, 1e5)
    plain = optimize(problem, [Stage(6, robust=False)], seed=3)
    before = problem.evaluate(plain.density, plain.final.equilibrium.state, plain.pressures)
    after = optimize(problem, [Stage(6)], after=plain).final
    assert before.spread is not None
    assert after.spread is not None
    assert after.spread < before.spread / 2
    assert after.objective < before.objective


@pytest.mark.parametrize(
    ("width", "weight", "message"),
    [
        (1e-3 * RADIUS, 1.0, "too close to be told apart"),
        (0.6 * RADIUS, 1.0, "lines or gaps of the least width vanish"),
        (-1e-4, 1.0, "width_tolerance"),
        (0.1 * RADIUS, 0.0, "spread_weight"),
    ],
)
def test_bad_tolerances(tube: Skin, width: float, weight: float, message: str) -> None:
    problem = make_problem(tube, solver(tube))
    with pytest.raises(ParameterError, match=message):
        Variants(WidthTolerance(width, weight), problem.filter, 0.5, lambda: problem.solver)
