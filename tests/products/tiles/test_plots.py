"""Full circles of a profile by its symmetry."""

import numpy as np
import pytest

from toros_fem.products.tiles.plots import full_circle


def test_tetragonal_circle() -> None:
    angles = np.radians([0.0, 22.5, 45.0])
    turn, values = full_circle(angles, np.array([3.0, 2.0, 1.0]), "tetragonal")
    assert len(turn) == 17
    assert np.diff(turn) == pytest.approx(np.pi / 8)
    assert values == pytest.approx([3, 2, 1, 2] * 4 + [3])


def test_orthotropic_circle() -> None:
    angles = np.radians([0.0, 45.0, 90.0])
    turn, values = full_circle(angles, np.array([3.0, 2.0, 1.0]), "orthotropic")
    assert turn == pytest.approx(np.arange(9) * np.pi / 4)
    assert values == pytest.approx([3, 2, 1, 2] * 2 + [3])


def test_chiral_circle() -> None:
    """Quarter turns repeat directions; there are no mirrors."""
    angles = np.radians([0.0, 30.0, 60.0])
    turn, values = full_circle(angles, np.array([3.0, 2.0, 1.0]), "chiral")
    assert turn == pytest.approx(np.arange(13) * np.pi / 6)
    assert values == pytest.approx([3, 2, 1] * 4 + [3])


def test_circle_without_symmetry() -> None:
    """Only n and −n have equal values."""
    angles = np.radians([0.0, 60.0, 120.0])
    turn, values = full_circle(angles, np.array([3.0, 2.0, 1.0]), "none")
    assert turn == pytest.approx(np.arange(7) * np.pi / 3)
    assert values == pytest.approx([3, 2, 1] * 2 + [3])
