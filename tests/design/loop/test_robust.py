"""Robust designs: eroded and dilated patterns of the same filtered density."""

import dataclasses

import numpy as np
import pytest
from helpers.designs import RADIUS, full
from helpers.loops import OneEntry, Stopped, figures

from toros_fem.design.loop.fields import densities_of
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.physics import InflatedSkin
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
    fields = densities_of(plain.fields)

    def variant() -> InflatedSkin:
        return dataclasses.replace(plain.physics, solver=solver(tube))

    return plain.changed(robust=Variants(tolerance, fields.filter, fields.projection.eta, variant))


def test_without_variants_nothing_differs(short_tube: Skin) -> None:
    """Stages that are not robust are those of the plain problem to the last bit."""
    plain = optimize(full(short_tube, solver(short_tube)), [Stage(3)], seed=3)
    off = optimize(robust(short_tube), [Stage(3, robust=False)], seed=3)
    assert [figures(r) for r in off.history] == [figures(r) for r in plain.history]
    assert np.array_equal(off.density, plain.density)
    assert not off.final.variants


def test_a_stopped_design_goes_on_bit_for_bit(short_tube: Skin) -> None:
    options = DesignOptions((Stage(3),))
    whole = optimize(robust(short_tube), options, seed=3)
    stopping = OneEntry(stop_at=2)
    with pytest.raises(Stopped):
        optimize(robust(short_tube), options, seed=3, journal=stopping)
    again = optimize(robust(short_tube), options, seed=3, journal=OneEntry(saved=stopping.kept))
    assert [figures(r) for r in again.history] == [figures(r) for r in whole.history]
    for one, two in zip(again.final.variants, whole.final.variants, strict=True):
        assert np.array_equal(one.state, two.state)


def test_the_spread_falls(short_tube: Skin) -> None:
    """Plain steps, and as many robust ones from there."""
    problem = robust(short_tube, 1e5)
    plain = optimize(problem, [Stage(6, robust=False)], seed=3)
    before = problem.simulate(plain.density, plain.final.equilibrium.state, plain.pressures)
    after = optimize(problem, [Stage(6)], after=plain).final
    assert after.spread < before.spread / 2
    assert after.objective < before.objective


def test_the_spread_of_a_print_that_is_known(short_tube: Skin) -> None:
    problem, pattern = robust(short_tube, 1e5), short_tube.pattern
    along = pattern.points[pattern.triangles].mean(axis=1)[short_tube.owned_cells, 2]
    density = 0.5 + 0.3 * np.sin(2 * np.pi * along / 0.03)
    before = problem.simulate(density)
    printed = 0.3 * (before.equilibrium.positions - pattern.points[short_tube.owned_vertices])
    both = [variant.positions for variant in before.variants]
    problem = problem.changed(robust=problem.robust.corrected(printed, *both))
    x, forward = before.equilibrium.positions, problem.objective.forward
    expected = (forward(x + printed) + forward(x - printed)) / 2 - forward(x)
    here = problem.simulate(density)
    assert here.spread == pytest.approx(expected, rel=1e-6)
    assert here.steps > here.equilibrium.steps
    made = problem.simulate_binary(np.where(along < 0.03, 1.0, 0.0))
    assert len(problem.differentiate(made).gradient) == len(density), "a print has no variants"


def test_a_print_needs_no_solvers_of_variants(short_tube: Skin) -> None:
    problem = robust(short_tube)
    problem.simulate_binary(np.zeros(len(short_tube.owned_cells), dtype=bool))
    assert "physics" not in vars(problem.robust), "they are made where they are first needed"
