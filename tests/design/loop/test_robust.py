"""Robust designs: eroded and dilated patterns of the same filtered density."""

import numpy as np
import pytest
from helpers.designs import robust
from helpers.loops import figures

from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import Stage
from toros_fem.meshes import Skin


def test_without_variants_nothing_differs(short_tube: Skin) -> None:
    """Stages that are not robust are those of the plain problem to the last bit."""
    plain = optimize(robust(short_tube).changed(robust=None), [Stage(3)], seed=3)
    off = optimize(robust(short_tube), [Stage(3, robust=False)], seed=3)
    assert [figures(r) for r in off.history] == [figures(r) for r in plain.history]
    assert np.array_equal(off.density, plain.density)
    assert not off.final.variants


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
