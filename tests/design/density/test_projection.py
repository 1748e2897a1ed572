"""Projection: values, derivative, parameters."""

import numpy as np
import pytest
from helpers.scenes import table
from kit.slopes import slope

from toros_fem.base.array_types import Floats
from toros_fem.design.density.projection import Projection


def test_projection_against_the_table() -> None:
    for row in table("heaviside"):
        filtered = np.array([float(row["rho_tilde"])])
        for name, value in row.items():
            if name.startswith("beta="):
                projected = Projection(float(name[5:]), 0.5).forward(filtered)
                assert projected[0] == pytest.approx(float(value), abs=1e-9)


@pytest.mark.parametrize("eta", [0.3, 0.5, 0.7])
def test_derivative(eta: float) -> None:
    """Outside of [0, 1], where obtuse meshes lead, the projection stays at its ends."""
    x: Floats = np.asarray(np.linspace(-0.2, 1.2, 351)[1::2], dtype=np.float64)
    projection = Projection(4.0, eta)
    rise = slope(lambda h: projection.forward(x + 1e-4 * h)) / 1e-4
    assert projection.backward(x, np.full(len(x), 3.0)) == pytest.approx(3 * rise, abs=1e-8)
    assert projection.forward(x)[[0, -1]] == pytest.approx([0, 1], abs=0)
    assert projection.backward(np.array([0.0, 1.0]), np.ones(2)).min() > 0, "the ends are inside"
