"""Harmonic extension over the flat panels."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import Skin, rectangle
from toros_fem.meshes.harmonic_extension import flat_laplacian, harmonic_extension


def test_a_linear_function_is_harmonic() -> None:
    pattern = rectangle(MPI.COMM_SELF, 0.1, 0.04, 6e-3, mesh="unstructured")
    x, y, _ = pattern.points.T
    values = 2 * x - 3 * y
    fixed = (np.minimum(x, x.max() - x) < 1e-9) | (np.minimum(y, y.max() - y) < 1e-9)
    assert 0 < fixed.sum() < len(fixed) / 2
    extend = harmonic_extension(flat_laplacian(pattern), fixed)
    assert extend(np.where(fixed, values, 7.0)) == pytest.approx(values, abs=1e-8)


def test_fixed_values_are_kept_and_bound_the_others(tube: Skin) -> None:
    values = np.random.default_rng(3).random(len(tube.pattern.points))
    fixed = values > 0.7
    found = harmonic_extension(flat_laplacian(tube.pattern), fixed)(values)
    np.testing.assert_array_equal(found[fixed], values[fixed])
    assert found.max() == values.max()
    # The mesh of the tube has a few obtuse triangles, by which harmonic values may overshoot.
    assert found.min() > 0.65


def test_all_or_none_fixed(tube: Skin) -> None:
    laplacian, values = flat_laplacian(tube.pattern), np.ones(len(tube.pattern.points))
    every = np.ones(len(values), dtype=bool)
    np.testing.assert_array_equal(harmonic_extension(laplacian, every)(values), values)
    np.testing.assert_array_equal(harmonic_extension(laplacian, ~every)(values), 0 * values)
