"""Pressure and strains of a bare tube: small strain, a simulated tube, stretch bounds."""

import math

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import Composite, EquilibriumSolver, Load, clamp, sew, symmetry_plane
from toros_fem.mechanics.readings.bare_tube import tube_pressure, tube_strains
from toros_fem.meshes import cylinder


def test_small_strain() -> None:
    """E h times the strain along is p r (1/2 − ν), times that around p r (1 − ν/2)."""
    sheet, radius, pressure = Composite(), 0.01, 1.0
    around, along = tube_strains(sheet, radius, pressure)
    load = pressure * radius / 50.0
    assert along == pytest.approx(load * (0.5 - 0.3), rel=2e-3)
    assert around == pytest.approx(load * (1 - 0.15), rel=2e-3)


@pytest.mark.parametrize("strain", [0.05, 0.3, 0.6])
def test_one_is_the_inverse_of_the_other(strain: float) -> None:
    pressure = tube_pressure(Composite(), 0.01, strain)
    assert tube_strains(Composite(), 0.01, pressure)[1] == pytest.approx(strain, rel=1e-9)


def test_no_pressure_reaches_the_stretch_bound() -> None:
    assert tube_pressure(Composite(), 0.01, 0.9) == math.inf
    assert tube_pressure(Composite(), 0.01, 0.89) < math.inf


@pytest.mark.slow
def test_a_simulated_tube(alone: MPI.Comm) -> None:
    """The middle of a long tube; its mesh has 18 edges around, and its ends are held."""
    length, edge = 0.2, 3.4e-3
    tube = cylinder(alone, length, 0.02, edge, planes=(1,))
    supports = clamp(tube, ["base"]) | symmetry_plane(tube, 1)
    skin, sheet = sew(alone, tube), Composite(bending=None)
    density = np.where(tube.panel == tube.panel_index("wall"), 0.0, 1.0)
    pressure = tube_pressure(sheet, 0.01, 0.3)
    found = EquilibriumSolver(skin, sheet, supports).solve(
        density[skin.owned_cells], Load(pressure)
    )
    height, at = tube.points[:, 2], skin.gather_vertices(found.positions)[:, 2]
    slope = np.polyfit(height[middle := abs(height - length / 2) < 0.05], at[middle], 1)[0]
    assert slope - 1 == pytest.approx(0.3, rel=0.02)
