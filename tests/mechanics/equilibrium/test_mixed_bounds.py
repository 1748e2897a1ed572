"""Equilibria of a print that hardly stretches on a fabric that does, and their gradients."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.standing import solver_on_base
from helpers.warned import warned

from toros_fem import errors
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.stretch_bounds import singular_values
from toros_fem.meshes import Skin

# The print reaches the bound of its stretch under the pressures of these tests.
SOFT = replace(Composite().reinforcement, young=2e6)
TIGHT = Composite(reinforcement=replace(SOFT, c1=1.05))


@pytest.fixture(scope="module")
def solver(short_tube: Skin) -> EquilibriumSolver:
    return solver_on_base(short_tube, TIGHT)


def print_of(skin: Skin, seed: int) -> np.ndarray:
    """Stripes at a random angle across the wall, with soft borders; all of the ends."""
    pattern, rng = skin.pattern, np.random.default_rng(seed)
    x, y = pattern.centroids.T
    turn, start = rng.uniform(0, np.pi), rng.uniform(0, 2 * np.pi)
    wave = np.sin(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / 0.015 + start)
    wall = pattern.panel == pattern.panel_index("wall")
    return np.where(wall, 1 / (1 + np.exp(-8 * wave)), 1.0)[skin.owned_cells]


def largest_stretch(solver: EquilibriumSolver, state: np.ndarray, where: np.ndarray) -> float:
    bounds, model = solver.model.bounds, solver.model
    big, _ = singular_values(bounds.gradient(model.corners(state)))
    stretches = solver.skin.gather_cells(big)
    return float(stretches[solver.skin.gather_cells(where.astype(float)) > 0.5].max())


def test_random_prints_inflate_within_their_bounds(solver: EquilibriumSolver) -> None:
    """From 5 to 20 kPa; then all that is print becomes fabric, and the other way round."""
    printed_most = []
    for seed, pressure in enumerate((5e3, 8e3, 12e3, 16e3, 20e3)):
        density = print_of(solver.skin, seed)
        found = solver.solve(density, pressure)
        assert found.stretch_use < 1
        printed_most.append(largest_stretch(solver, found.state, density > 0.999))
        assert largest_stretch(solver, found.state, density < 1e-3) > 1.2
        swapped = solver.solve(1 - density, pressure, start=found.state)
        assert swapped.stretch_use < 1
        assert largest_stretch(solver, swapped.state, density < 1e-3) < 1.051
    assert 1.049 < max(printed_most) < 1.051, "the bound must matter"


def test_bounds_that_carry_the_load(short_tube: Skin) -> None:
    """Ten times the stretch that the bound leaves: the forces keep their digits."""
    narrow = Composite(reinforcement=replace(SOFT, c1=1.02, c2=1.04))
    solver = solver_on_base(short_tube, narrow)
    density = print_of(short_tube, 2)
    found = solver.solve(density, 20e3)
    assert found.residual <= solver.options.tolerance
    assert found.stretch_use > 0.98
    assert 1.015 < largest_stretch(solver, found.state, density > 0.999) < 1.021


def test_a_start_outside_narrower_bounds_is_taken_inside(short_tube: Skin) -> None:
    """A trial too: a design step that prints stretched fabric costs no failed solve."""
    solver = solver_on_base(short_tube, TIGHT)
    plain = solver.solve(np.zeros(len(short_tube.owned_cells)), 5e3)
    density = print_of(short_tube, 1)
    trial = solver.solve(density, 5e3, start=plain.state, trial=True)
    assert trial.converged
    found = solver.finish(trial)
    cold = solver.solve(density, 5e3)
    assert found.energy == pytest.approx(cold.energy, rel=1e-8)
    assert found.volume == pytest.approx(cold.volume, rel=1e-6)
    # Outside the bounds of either material no mixture exists.
    with pytest.raises(errors.ParameterError, match=r"c1 = 1.05, c2 = 2.6 of the print"):
        solver.solve(density, 5e3, start=3 * solver.model.assembled)


def test_a_print_that_stretches_further_is_odd(short_tube: Skin) -> None:
    wide = Composite(reinforcement=replace(SOFT, c1=2.5), bending=None)
    with warned(short_tube.comm, "stretches no further than without"):
        solver_on_base(short_tube, wide)


def test_failures_state_both_bounds(short_tube: Skin, solver: EquilibriumSolver) -> None:
    failed = solver.solve(
        np.zeros(len(short_tube.owned_cells)), 1e9, trial=True, raise_on_failure=False
    )
    assert not failed.converged
    assert "(c1 = 1.9, c2 = 2.6 of the fabric, c1 = 1.05, c2 = 2.6 of the print)" in failed.reason
