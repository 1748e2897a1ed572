"""The shared tube on one rank: what depends on their number takes `comm`."""

import pytest
from mpi4py import MPI

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Skin, cylinder, sew


@pytest.fixture(scope="session")
def tube(alone: MPI.Comm) -> Skin:
    return sew(alone, cylinder(alone, 0.06, 0.02, 4.5e-3))


@pytest.fixture(scope="session")
def tube_solver(tube: Skin) -> EquilibriumSolver:
    return EquilibriumSolver(tube, Composite(), clamp(tube.pattern, ["base"]))
