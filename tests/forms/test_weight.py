"""Potential of a triangle's weight."""

import numpy as np
import pytest
from helpers.expressions import number, vector

from toros_fem.forms.weight import weight_potential


def test_weight_of_a_triangle() -> None:
    """Mass times gravity times the height of its middle."""
    x = np.random.default_rng(2).standard_normal((3, 3))
    gravity = vector(np.array([0.0, 0.0, -9.81]))
    found = weight_potential([tuple(p) for p in x], 0.4, gravity)
    assert number(found) == pytest.approx(0.4 * 9.81 * x[:, 2].mean(), rel=1e-14)
