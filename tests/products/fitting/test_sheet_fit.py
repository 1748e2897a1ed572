"""Both moduli from one test of a printed sheet, found again from simulated data."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.tensile_tests import pulled_sheet
from mpi4py import MPI

from toros_fem.products.fitting.sheet_fit import fit_printed_sheet
from toros_fem.products.tiles.pulled_sheet import cross_tile

# True moduli over those that the fit starts from.
FACTORS = np.array([1.6, 0.5])


@pytest.mark.slow
def test_both_moduli_of_one_test(alone: MPI.Comm) -> None:
    tile = replace(cross_tile(), edge_length=2e-3)
    test = pulled_sheet(alone, tile, FACTORS, np.linspace(0.01, 0.12, 8))
    rng = np.random.default_rng(4)
    noisy = replace(
        test,
        stress=test.stress * (1 + 0.005 * rng.standard_normal(8)),
        lateral=test.lateral + 0.0005 * rng.standard_normal(8),
    )
    found = fit_printed_sheet(alone, [noisy], tile, 2, 1)
    for name, factor in zip(("fabric", "reinforcement"), FACTORS, strict=True):
        expected = factor * getattr(tile.composite, name).young
        assert expected in found.estimates[name]
        assert found.estimates[name].value == pytest.approx(expected, rel=0.1)
        assert found.estimates[name].low > 0.7 * expected
        assert getattr(found.composite, name).young == found.estimates[name].value
    assert found.r2_stress > 0.995
