"""Several stable states of a skin that crumples."""

import numpy as np
import pytest
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.states import find_states
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes import Skin, sew
from toros_fem.meshes.makers.sheets import disc

RADIUS = 0.02


def mylar(comm: MPI.Comm) -> tuple[Skin, EquilibriumSolver, float]:
    """Half of two stiff discs sewn along their border, flat, and a pressure that hardly strains."""
    pattern = disc(comm, RADIUS, RADIUS / 6, "structured")
    points = pattern.points
    border = np.unique(pattern.free_edges)
    fixed = symmetry_plane(pattern, 2).fixed
    for direction, axis in (((-1, 0), 1), ((1, 0), 1), ((0, 1), 0)):
        fixed[border[np.argmax(points[border, :2] @ direction)], axis] = True
    stiff = Material(1e6, 0.3, 1e-3)
    composite = Composite(fabric=stiff, reinforcement=stiff, c1=1.8, c2=2.0, bending=None)
    skin = sew(comm, pattern)
    pressure = stiff.membrane_stiffness / (200 * RADIUS)
    return skin, EquilibriumSolver(skin, composite, Supports(fixed)), pressure


def test_a_flat_skin_is_opened_first(alone: MPI.Comm) -> None:
    """Started from the first crumples it stays there, with two thirds of the volume."""
    skin, solver, pressure = mylar(alone)
    density = np.zeros(len(skin.owned_cells))
    opened = solver.solve(density, pressure)
    lift = solver.model.assembled
    flat = np.linalg.norm(skin.pattern.points[skin.owned_vertices, :2], axis=1)
    solver.model.positions(lift)[:, 2] += 1e-3 * RADIUS * (1 - (flat / RADIUS) ** 2)
    crumpled = solver.solve(density, pressure, start=lift)
    assert opened.energy < 1.3 * crumpled.energy < 0
    assert opened.volume > 1.2 * crumpled.volume


def test_states_are_found_and_counted(alone: MPI.Comm) -> None:
    skin, solver, pressure = mylar(alone)
    density = np.zeros(len(skin.owned_cells))
    first = solver.solve(density, pressure)
    found = find_states(solver, density, pressure, start=first, tries=9, size=0.1)
    assert len(found.energies) > 1
    assert sum(found.counts) + found.failures == 10
    assert list(found.energies) == sorted(found.energies)
    assert found.best.energy == pytest.approx(found.energies[0], rel=1e-6)
    assert found.best.energy <= first.energy
    assert f"{len(found.energies)} stable states seen" in str(found)
    # The solver's factors belong to the best one.
    assert solver.reactions(found.best).any()


def test_one_state_is_one(short_tube: Skin) -> None:
    stiff = Composite(bending=None)
    solver = solver_on_base(short_tube, stiff)
    found = find_states(solver, np.zeros(len(short_tube.owned_cells)), 2e3, tries=4)
    assert len(found.energies) == 1
    assert found.counts == (5,)
    assert str(found).startswith("1 stable state seen")
