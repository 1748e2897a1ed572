"""Admissible stretches, and steps that stay among them."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.mechanics.skin.stretch_bounds import StretchBounds, singular_values


def test_stretches_against_singular_values() -> None:
    F = np.random.default_rng(1).standard_normal((200, 3, 2))
    F[0] = [[1, 0], [0, 1], [0, 0]]
    big, small = singular_values(F)
    expected = np.linalg.svd(F, compute_uv=False)
    assert np.stack([big, small], axis=1) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_feasibility_is_tested_by_the_stretches() -> None:
    flat = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=float)
    bounds = StretchBounds(MPI.COMM_SELF, flat[..., :2], 1.8, 10.0)
    assert bounds.worst(2.5 * flat) > 1
    assert bounds.worst(1.5 * flat) == pytest.approx(0.5 / 0.8)
    assert bounds.worst(flat * [1, 0, 0]) == np.inf, "a collapsed triangle"
    assert bounds.worst(np.full((1, 3, 3), np.nan)) == np.inf
    step = bounds.largest_step(flat, flat, 0.9)
    assert step == pytest.approx(0.72, abs=1e-5), "0.9 of the way from 1 to the bound 1.8"
    assert bounds.largest_step(flat, 0.1 * flat, 0.9) == 1.0
