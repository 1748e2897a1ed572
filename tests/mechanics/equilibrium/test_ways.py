"""Ways to an equilibrium: the first that is tried for a skin that crumples."""

import numpy as np
from mpi4py import MPI

from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
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
