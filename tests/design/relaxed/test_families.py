"""Variables of line families: gradients, limits, and turns of a chart."""

import numpy as np
import pytest

from toros_fem.design.relaxed.problem import FixedDirections, FreeDirections


def test_sum_of_fixed_shares_stays_below_its_limit() -> None:
    families = FixedDirections(12, 0.35)
    shares = families.forward(np.ones((1, 12)))[:, 1:13]
    assert 0.99 * 0.35 < shares.sum() < 0.35
    few = families.forward(np.full((1, 12), 1e-3))[:, 1:13]
    assert few == pytest.approx(0.35e-3, rel=1e-6)


def test_free_directions_return_what_they_were_given() -> None:
    families = FreeDirections()
    shares, angles = np.array([[0.1, 0.02]]), np.array([[0.3, 2.0]])
    material = families.forward(families.variables(shares, angles))
    assert material[0, 0] == 0
    assert material[0, 1:3] == pytest.approx(shares[0])
    assert np.arctan2(material[0, 5:], material[0, 3:5]) / 2 % np.pi == pytest.approx(angles[0])


@pytest.mark.parametrize("turn", [0.3, -1.2, 3.0])
def test_a_turned_chart_turns_the_lines(turn: float) -> None:
    free = FreeDirections()
    x = free.variables(np.array([[0.1, 0.2]]), np.array([[0.4, 1.1]]))[0]
    there = free.centre + free.transport(turn) @ (x - free.centre)
    material = free.forward(there[None])[0]
    assert np.exp(1j * np.arctan2(material[5:], material[3:5])) == pytest.approx(
        np.exp(2j * (np.array([0.4, 1.1]) + turn))
    )
    fixed = FixedDirections(12)
    shares = np.zeros(12)
    shares[3] = 1.0
    turned = fixed.transport(turn) @ shares
    assert turned.sum() == pytest.approx(1)
    assert turned.min() >= 0
    mean = np.angle(turned @ np.exp(2j * fixed.angles))
    # A direction is shared out between its two neighbours: a few hundredths of a step off.
    assert np.exp(1j * mean) == pytest.approx(np.exp(2j * (fixed.angles[3] + turn)), abs=0.01)
