"""Pull tests of sheets and predictions by the periodic tile, against exact laws."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.scenes import TABLE_A, table
from mpi4py import MPI

from toros_fem import errors
from toros_fem.materials.sheet import Composite
from toros_fem.meshes import rectangle, sew
from toros_fem.products.tiles.printed_tile import tile_sheet
from toros_fem.products.tiles.pull_test import PullMachine, PullTest, pull_sheet
from toros_fem.products.tiles.pulled_sheet import cross_tile

SIZE = 0.01
STRAIN = 0.1
PLAIN = Composite(fabric=TABLE_A, c1=1.8, c2=2.0, bending=None)


def exact(kind: str) -> tuple[float, float]:
    """Return stress in N/m and contraction of the plain fabric at a strain of 10 %."""
    if kind == "uniaxial":
        rows = [r for r in table("gent_uniaxial") if r["mat"] == "A"]
        row = min(rows, key=lambda r: abs(float(r["stretch"]) - 1 - STRAIN))
        stress, across = float(row["nominal_stress_Pa"]), float(row["lateral_stretch"])
    else:
        rows = [r for r in table("gent_equibiaxial_planestrain") if r["mat"] == "A"]
        row = min(rows, key=lambda r: abs(float(r["stretch"]) - 1 - STRAIN))
        stress, across = float(row["P11_strip_l2=1_Pa"]), 1.0
    assert float(row["stretch"]) == 1 + STRAIN
    return stress * TABLE_A.thickness, (1 - across) / STRAIN


def pulled_fabric(comm: MPI.Comm, ratio: float, axis: int, **changes: Any) -> PullTest:
    """Pull a plain sheet with this ratio of length to width."""
    sides = (ratio * SIZE, SIZE)
    pattern = rectangle(comm, *(sides if axis == 0 else sides[::-1]), min(sides) / 5, "crossed")
    skin = sew(comm, pattern)
    density = np.zeros(len(skin.owned_cells))
    machine = PullMachine(skin, PLAIN, axis, SIZE)
    return machine.pull(density, changes.get("strains", [STRAIN / 2, STRAIN]))


@pytest.mark.parametrize("axis", [0, 1])
def test_plain_fabric_lies_between_uniaxial_and_clamped(alone: MPI.Comm, axis: int) -> None:
    """The excess stress due to the clamps is inversely proportional to the length."""
    free, contraction = exact("uniaxial")
    clamped, _ = exact("plane strain")
    excess = []
    for ratio in (1, 4, 8):
        test = pulled_fabric(alone, ratio, axis)
        assert free < test.stress[-1] < clamped
        assert test.imbalance < 1e-8
        excess.append(test.stress[-1] / free - 1)
    assert excess[0] > 0.04
    assert excess[2] == pytest.approx(excess[1] / 2, rel=0.05)
    # Far from the clamps the state is uniaxial.
    assert test.middle_contraction[-1] == pytest.approx(contraction, rel=1e-4)
    assert test.middle_strain[-1] > STRAIN
    assert test.contraction[-1] > contraction


def test_cross_lines_alike_along_x_and_y(comm: MPI.Comm) -> None:
    """The sheets of a square tile agree in both directions, though the mesh is not symmetric."""
    drawn = replace(cross_tile(), edge_length=SIZE / 10)
    mesh, printed = drawn.tile(comm)
    strains = np.array([0.05, STRAIN])
    along_x, along_y = (
        pull_sheet(comm, tile_sheet(mesh, name, 12, 3), printed, drawn.composite, strains)
        for name in "xy"
    )
    for one in (along_x, along_y):
        assert one.test.imbalance < 1e-8
        summary = one.summary()
        # Clamps keep the ends wide; the middle is pulled as the tile is.
        assert summary["stiffness_ratio"] == pytest.approx(1, abs=0.05)
        clamped = summary["between_clamps"]
        assert clamped["stiffness_n_per_m"] > 1.1 * clamped["stiffness_predicted_n_per_m"]
        assert 0 < summary["contraction"] < clamped["contraction"]
        assert summary["strain"] > STRAIN
    assert along_x.predicted.stress == pytest.approx(along_y.predicted.stress, rel=5e-3)
    assert along_x.test.stress == pytest.approx(along_y.test.stress, rel=5e-3)
    assert along_x.test.middle_contraction == pytest.approx(
        along_y.test.middle_contraction, rel=5e-3
    )
    assert np.diff(along_x.predicted.stiffness) > 0, "the lines rotate towards the pull"


def test_a_pull_beyond_the_bounds(alone: MPI.Comm) -> None:
    with pytest.raises(errors.NoEquilibriumError, match="supports moved"):
        pulled_fabric(alone, 1, 0, strains=[0.9])
