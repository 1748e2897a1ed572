"""Projection: values, derivative, parameters."""

import numpy as np
import pytest
from helpers.scenes import table

from toros_fem.design.density.projection import Projection


def test_projection_against_the_table() -> None:
    for row in table("heaviside"):
        filtered = np.array([float(row["rho_tilde"])])
        for name, value in row.items():
            if name.startswith("beta="):
                projected = Projection(float(name[5:]), 0.5).forward(filtered)
                assert projected[0] == pytest.approx(float(value), abs=1e-9)


@pytest.mark.parametrize("eta", [0.3, 0.5, 0.7])
def test_ends(eta: float) -> None:
    """Outside of [0, 1], where obtuse meshes lead, the projection stays at its ends."""
    projection, outside = Projection(4.0, eta), np.array([-0.2, -0.01, 1.01, 1.2])
    assert projection.forward(outside) == pytest.approx([0, 0, 1, 1], abs=0)
    assert projection.backward(outside, np.ones(4)) == pytest.approx(0, abs=0)
    assert projection.backward(np.array([0.0, 1.0]), np.ones(2)).min() > 0, "the ends are inside"


def test_power() -> None:
    """ρ̄ of the paper, to a power; its derivative by differences."""
    filtered: np.ndarray = np.linspace(0.05, 0.95, 19)
    paper, taken = Projection(8.0, 0.4), Projection(8.0, 0.4, power=2.5)
    assert taken.forward(filtered) == pytest.approx(paper.forward(filtered) ** 2.5, rel=1e-14)
    ends = (taken.forward(filtered + step) for step in (1e-6, -1e-6))
    slope = np.subtract(*ends) / 2e-6
    assert taken.backward(filtered, np.ones(19)) == pytest.approx(slope, rel=1e-7)
