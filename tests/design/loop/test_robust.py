"""Robust designs: eroded and dilated patterns of the same filtered density."""

import numpy as np
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


def test_a_print_needs_no_solvers_of_variants(short_tube: Skin) -> None:
    problem = robust(short_tube)
    problem.simulate_binary(np.zeros(len(short_tube.owned_cells), dtype=bool))
    assert "physics" not in vars(problem.robust), "they are made where they are first needed"
