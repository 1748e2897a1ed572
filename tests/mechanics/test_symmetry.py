"""A part of a flat robot at its symmetry planes does what the whole does."""

import numpy as np
import pytest
from helpers.symmetry import rests
from mpi4py import MPI

from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.materials import Bending, Composite
from toros_fem.meshes import Mirrored, Pattern, mirrored, sew, walker

EDGE = 7e-3
CLOTH = Composite(bending=Bending(seams="hinged"))


def inflated(
    comm: MPI.Comm, pattern: Pattern, planes: tuple[int, ...], density: np.ndarray
) -> tuple[np.ndarray, float]:
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(skin, CLOTH, rests(pattern, planes))
    found = solver.solve(density[skin.owned_cells], 3e3)
    return skin.gather_vertices(found.positions), found.volume


@pytest.mark.parametrize("reinforced", [False, True])
def test_quarter_half_and_whole_agree(comm: MPI.Comm, reinforced: bool) -> None:
    """On meshes that mirror each other to rounding, with a pattern that is not symmetric in z."""
    quarter = walker(comm, EDGE, planes=(0, 1))
    density = np.zeros(len(quarter.panel))
    if reinforced:
        stripe = quarter.centroids @ [0.5**0.5, -(0.5**0.5)]
        density[(quarter.panel == 1) & (stripe > 0.03) & (stripe < 0.05)] = 1.0
    positions, volume = inflated(comm, quarter, (0, 1), density)
    for axes, left in (((0, 1), ()), ((0,), (1,))):
        more: Mirrored = mirrored(quarter, axes)
        whole, enclosed = inflated(comm, more.pattern, left, more.at_cells(density))
        assert enclosed == pytest.approx(2 ** len(axes) * volume, rel=1e-9)
        assert whole == pytest.approx(more.at_vertices(positions), abs=1e-9)
    low, high = positions[:, 2].min(), positions[:, 2].max()
    assert high - low > 0.02
    # Unless it is reinforced, top and bottom inflate alike.
    tip = positions[np.argmax(positions[:, 0] + positions[:, 1]), 2]
    assert (abs(tip - (low + high) / 2) > 1e-4) == reinforced


def test_whole_meshed_on_its_own_agrees(comm: MPI.Comm) -> None:
    parts: list[tuple[int, ...]] = [(), (0,), (1,), (0, 1)]
    volumes, reaches = [], []
    for planes in parts:
        pattern = walker(comm, 5e-3, planes=planes)
        positions, volume = inflated(comm, pattern, planes, np.zeros(len(pattern.panel)))
        volumes.append(2 ** len(planes) * volume)
        reaches.append((positions[:, 0] + positions[:, 1]).max())
    assert volumes == pytest.approx(4 * [np.mean(volumes)], rel=0.005)
    assert reaches == pytest.approx(4 * [np.mean(reaches)], rel=0.01)
