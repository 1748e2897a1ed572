"""A skin through a sequence of pressures."""

import numpy as np
import pytest

from toros_fem.analysis.pressure_path import trace_pressure_path
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_a_path_is_followed(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    density = np.full(len(tube.owned_cells), 0.3)
    points = list(trace_pressure_path(tube_solver, density, [500.0, 1e3, 2e3]))
    alone = tube_solver.solve(density, 2e3)
    assert points[-1].result.volume == pytest.approx(alone.volume, rel=1e-8)
    assert [point.result.pressure for point in points] == [500.0, 1e3, 2e3]
    begun = list(trace_pressure_path(tube_solver, density, [2e3], start=alone.positions))
    assert begun[0].result.steps <= 1
