"""Two families that stand for many."""

import numpy as np
import pytest
from helpers.line_fields import two_sheets
from helpers.scenes import square

from toros_fem.design.lines.field import LineField
from toros_fem.design.relaxed.find import fitted_pair

ANGLES = np.pi * np.arange(12) / 12


def test_two_directions_and_those_between() -> None:
    """45° and 120° exactly, and 67° as two neighbours in proportion."""
    pattern = square()
    count = len(pattern.panel)
    shares = np.zeros((count, 12))
    shares[:, 3], shares[:, 8] = 0.1, 0.2
    field = fitted_pair(LineField(pattern, shares, np.tile(ANGLES, (count, 1))))
    # 120° is nearer to the second axis and comes first.
    assert field.shares == pytest.approx(np.tile([0.2, 0.1], (count, 1)))
    assert field.angles == pytest.approx(np.tile(ANGLES[[8, 3]], (count, 1)), abs=1e-9)
    shares[:, 4] = 0.1
    field = fitted_pair(LineField(pattern, shares, np.tile(ANGLES, (count, 1))))
    assert field.shares[:, 1] == pytest.approx(0.2)
    assert field.angles[:, 1] == pytest.approx((ANGLES[3] + ANGLES[4]) / 2, abs=0.01)


def test_families_keep_their_identity_where_they_turn() -> None:
    pattern = square(n=12)
    place = pattern.centroids[:, 0] / pattern.centroids[:, 0].max()
    turned = np.stack([0.3 + 0.5 * place, 1.6 + 0.5 * place], axis=1)
    near = np.exp(8 * np.cos(2 * (turned[:, :, None] - ANGLES)))
    shares = 0.1 * (near / near.sum(axis=2, keepdims=True)).sum(axis=1)
    field = fitted_pair(LineField(pattern, shares, np.tile(ANGLES, (len(place), 1))))
    off = np.angle(np.exp(2j * (field.angles[:, ::-1] - turned))) / 2
    assert np.abs(off).max() < np.radians(8)


def test_a_panel_with_a_turned_chart_has_the_same_families() -> None:
    turn = 1.2
    pattern = two_sheets(turn)
    count = len(pattern.panel)
    angles = ANGLES + turn * pattern.panel[:, None]
    shares = np.zeros((count, 12))
    shares[:, 1], shares[:, 5] = 0.1, 0.2
    field = fitted_pair(LineField(pattern, shares, angles))
    assert field.shares == pytest.approx(np.tile([0.2, 0.1], (count, 1)))
    there = field.angles - turn * pattern.panel[:, None]
    assert np.exp(2j * there) == pytest.approx(np.tile(np.exp(2j * ANGLES[[5, 1]]), (count, 1)))
