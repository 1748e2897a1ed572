"""The strip between its clamps: simulated, and fitted as it was tested."""

import numpy as np
import pytest
from helpers.tensile_tests import C1, C2, JERSEY
from mpi4py import MPI

from toros_fem import FitOptions, TensileTest, fit_material
from toros_fem.products.fitting import ClampedStrip, uniaxial_curve

OPTIONS = FitOptions(intervals="hessian")


@pytest.mark.slow
def test_a_clamped_strip_is_fitted_by_its_simulation(alone: MPI.Comm) -> None:
    """Data simulated on a short strip; taken for a free one, its E is 4 % too large or more."""
    strip = ClampedStrip(alone, 0.05, 0.05, edges=4)
    strain: np.ndarray = np.linspace(0.02, 0.6, 30)
    free, lateral = uniaxial_curve(JERSEY, C1, C2, 1 + strain)
    factor, shift = strip.correction(JERSEY, C1, C2, strain)
    assert (factor > 1.02).all()
    tests = [TensileTest(1 + strain, factor * free, JERSEY.thickness, lateral + shift)]
    found = fit_material(tests, OPTIONS, strip)
    assert 1 < found.rounds <= 8
    for name, value in (("young", JERSEY.young), ("poisson", JERSEY.poisson), ("c1", C1)):
        assert found.estimates[name].value == pytest.approx(value, rel=0.01)
    plain = fit_material(tests, OPTIONS)
    assert plain.rounds == 0
    assert plain.estimates["young"].value > 1.03 * JERSEY.young
