"""Projection: values, derivative, parameters."""

import numpy as np
import pytest
from helpers.scenes import table

from toros_fem import errors
from toros_fem.design.density.projection import Projection


def test_projection_against_the_table() -> None:
    for row in table("heaviside"):
        filtered = np.array([float(row["rho_tilde"])])
        for name, value in row.items():
            if name.startswith("beta="):
                projected = Projection(float(name[5:]), 0.5).forward(filtered)
                assert projected[0] == pytest.approx(float(value), abs=1e-9)


def test_parameters() -> None:
    with pytest.raises(errors.ParameterError, match="beta"):
        Projection(beta=0.0)
    with pytest.raises(errors.ParameterError, match="eta"):
        Projection(eta=1.5)


def test_integers_are_numbers() -> None:
    values = np.linspace(0, 1, 7).astype(np.float64)
    whole, plain = Projection(20, 0.5), Projection(20.0, 0.5)
    assert np.array_equal(whole.forward(values), plain.forward(values))
    assert np.array_equal(whole.backward(values, values), plain.backward(values, values))
    assert Projection(20, 0.5).forward(np.array([0, 1])) == pytest.approx([0, 1])
