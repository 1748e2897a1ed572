"""What both kinds of paths have in common."""

import numpy as np

from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.meshes import Skin


def test_a_path_stops_at_a_point(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    density = np.zeros(len(short_tube.owned_cells))
    path = trace(
        short_solver, density, [1e2, 2e2, 3e2, 4e2], stop=lambda point: point.result.pressure > 150
    )
    assert [point.pressure for point in path] == [1e2, 2e2]
