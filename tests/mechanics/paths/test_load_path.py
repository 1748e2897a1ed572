"""Paths of loads; their gradients are in contracts/test_pairs.py."""

import numpy as np
from helpers.touching import dragged
from mpi4py import MPI

from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.load_path import LoadPath
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes import Skin


def test_a_step_that_does_not_matter_has_no_gradient(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    path = LoadPath(short_solver, [Load(2e3), Load(4e3)])
    density = np.full(len(short_tube.owned_cells), 0.2)
    base = path.solve(density)
    along = np.ones_like(base[0].positions)
    found = path.gradient(density, base, [along, None])
    assert found.pressures[0, 0] != 0
    assert found.pressures[1, 0] == 0


def test_a_dragged_sheet_sticks_and_slides(alone: MPI.Comm) -> None:
    """On the ground and on the body, so that its gradient sees both."""
    path = dragged(alone)
    skin, friction = path.solver.skin, path.solver.model.contact.friction
    parts = []
    for at in path.solve(np.full(len(skin.owned_cells), 0.3))[1:]:
        anchors = friction.carried(at.sliding, np.array(at.poses))
        away = np.linalg.norm(skin.gather_vertices(at.positions) - anchors, axis=2)
        parts.append([away > 0.999e-4, (away > 1e-8) & (away < 0.999e-4)])
    slides, sticks = np.array(parts).sum(axis=(0, 3)).reshape(2, 2)
    assert slides.min() > 0
    assert sticks.min() > 0
