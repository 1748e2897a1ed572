"""Harmonic extension over the flat panels."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import rectangle
from toros_fem.meshes.harmonic_extension import flat_laplacian, harmonic_extension


def test_a_linear_function_is_harmonic() -> None:
    pattern = rectangle(MPI.COMM_SELF, 0.1, 0.04, 6e-3, mesh="unstructured")
    x, y, _ = pattern.points.T
    values = 2 * x - 3 * y
    fixed = (np.minimum(x, x.max() - x) < 1e-9) | (np.minimum(y, y.max() - y) < 1e-9)
    assert 0 < fixed.sum() < len(fixed) / 2
    extend = harmonic_extension(flat_laplacian(pattern), fixed)
    assert extend(np.where(fixed, values, 7.0)) == pytest.approx(values, abs=1e-8)
