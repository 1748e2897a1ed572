"""Both moduli from one test of a printed sheet, found again from simulated data."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import TensileTest
from toros_fem.meshes import sew
from toros_fem.products.fitting import fit_printed_sheet
from toros_fem.products.fitting.printed_sheet import scaled
from toros_fem.products.tiles.printed_tile import PrintedTile
from toros_fem.products.tiles.pull_test import pull
from toros_fem.products.tiles.pulled_sheet import cross_tile
from toros_fem.products.tiles.sheet import remesh, tile_sheet

ALONG, ACROSS = 2, 1
# True moduli over those that the fit starts from.
FACTORS = np.array([1.6, 0.5])


def small_tile(comm: MPI.Comm) -> PrintedTile:
    return remesh(comm, cross_tile(comm), 1.7e-3)


def simulated(comm: MPI.Comm) -> TensileTest:
    """A pull test of the sheet with other moduli, by other code than the fit's."""
    tile = small_tile(comm)
    sheet = tile_sheet(tile.tile(comm), "x", ALONG, ACROSS)
    skin = sew(comm, sheet.pattern)
    strains: np.ndarray = np.linspace(0.01, 0.12, 8)
    test = pull(
        skin,
        scaled(tile.composite, FACTORS),
        tile.printed.astype(float)[sheet.cell][skin.owned_cells],
        0,
        strains,
        2 * tile.size[0],
    )
    lateral = 1 - test.curve.contraction * strains
    return TensileTest(1 + strains, test.curve.stress, 5e-4, lateral, "sheet", "x")


@pytest.mark.slow
def test_both_moduli_of_one_test(alone: MPI.Comm) -> None:
    tile, test = small_tile(alone), simulated(alone)
    rng = np.random.default_rng(4)
    assert test.lateral is not None
    noisy = replace(
        test,
        stress=test.stress * (1 + 0.005 * rng.standard_normal(8)),
        lateral=test.lateral + 0.0005 * rng.standard_normal(8),
    )
    found = fit_printed_sheet(alone, [noisy], tile, ALONG, ACROSS)
    for name, factor in zip(("fabric", "reinforcement"), FACTORS, strict=True):
        expected = factor * getattr(tile.composite, name).young
        assert expected in found.estimates[name]
        assert found.estimates[name].value == pytest.approx(expected, rel=0.1)
        assert found.estimates[name].low > 0.7 * expected
        assert getattr(found.composite, name).young == found.estimates[name].value
    assert found.r2_stress > 0.995
