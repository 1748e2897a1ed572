"""What both kinds of paths have in common, and what they refuse."""

import numpy as np
import pytest

from toros_fem.base.errors import DensityError, ParameterError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.paths.trace import trace
from toros_fem.meshes import Skin


def test_a_path_stops_at_a_point(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    density = np.zeros(len(short_tube.owned_cells))
    path = trace(
        short_solver, density, [1e2, 2e2, 3e2, 4e2], stop=lambda point: point.result.pressure > 150
    )
    assert [point.pressure for point in path] == [1e2, 2e2]


def test_arguments_are_checked_at_once(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    density = np.zeros(len(short_tube.owned_cells))
    with pytest.raises(ParameterError, match="by = 'volume'"):
        trace(short_solver, density, 1e3, by="volume")  # type: ignore[call-overload]
    with pytest.raises(ParameterError, match="needs all pressures"):
        trace(short_solver, density, 1e3)  # type: ignore[call-overload]
    with pytest.raises(ParameterError, match='by="arc-length"'):
        trace(short_solver, density, [1e3], options=ArcLengthOptions())  # type: ignore[call-overload]
    with pytest.raises(ParameterError, match="no load acts"):
        trace(short_solver, density, 0.0, by="arc-length")
    with pytest.raises(ParameterError, match="must be finite and at least 0"):
        trace(short_solver, density, -1.0, by="arc-length")
    with pytest.raises(DensityError):
        trace(short_solver, density - 1, 1e3, by="arc-length")
