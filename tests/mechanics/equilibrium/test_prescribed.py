"""Prescribed displacements: fixed components jump, free ones follow harmonically."""

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.model import SkinModel, make_model
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.prescribed import PrescribedDisplacement
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import sew

SIZE = 0.02


@pytest.fixture(scope="module")
def strip(alone: MPI.Comm) -> SkinModel:
    """A flat sheet with two opposite borders fixed."""
    pattern = square(size=SIZE)
    x = pattern.points[:, 0]
    ends = (x < 1e-9) | (x > SIZE * (1 - 1e-9))
    fixed = np.repeat(ends[:, None], 3, axis=1)
    return make_model(sew(alone, pattern), Composite(bending=None), Supports(fixed))


def test_a_pulled_strip_is_stretched_evenly(strip: SkinModel) -> None:
    points = strip.skin.pattern.points
    moves = np.where(points[:, :1] > SIZE / 2, [[0.3 * SIZE, 0.0, 0.1 * SIZE]], 0.0)
    pull = Load(displacement=moves)
    place = PrescribedDisplacement(strip)
    moved = strip.skin.gather_vertices(strip.positions(place(strip.assembled, pull)))
    assert moved == pytest.approx(points + points[:, :1] * [0.3, 0.0, 0.1], abs=1e-7 * SIZE)
    # From there, back to the assembled positions.
    state = place(place(strip.assembled, pull), Load())
    assert strip.skin.gather_vertices(strip.positions(state)) == pytest.approx(
        points, abs=1e-7 * SIZE
    )


def test_free_components_keep_their_place_where_nothing_jumps(strip: SkinModel) -> None:
    state = strip.assembled
    state[strip.free] += 1e-3 * SIZE
    placed = PrescribedDisplacement(strip)(state, Load())
    assert np.array_equal(placed, state)


def test_supports_that_stay_cost_no_solves(alone: MPI.Comm) -> None:
    """A load without an equilibrium fails as soon with displacements of zero as without any."""
    pattern = square(size=SIZE, n=4)
    fixed = np.repeat(pattern.points[:, :1] < 0.3 * SIZE, 3, axis=1)
    options = NewtonOptions(max_steps=2, min_increment=1.0)
    solver = EquilibriumSolver(sew(alone, pattern), Composite(), Supports(fixed), options)
    density = np.zeros(len(solver.skin.owned_cells))
    force = np.zeros_like(pattern.points)
    force[pattern.points[:, 0] > SIZE * (1 - 1e-9), 0] = 0.05
    still = np.zeros_like(force)
    steps = [
        solver.solve(density, Load(0.0, force, displacement=of), raise_on_failure=False).steps
        for of in (None, still)
    ]
    assert 0 < steps[1] <= steps[0] + 2 * 2
