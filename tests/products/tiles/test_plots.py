"""Full circles of a profile by its symmetry."""

import numpy as np
import pytest

from toros_fem.products.tiles.plots import full_circle


@pytest.mark.parametrize(
    ("symmetry", "step", "expected"),
    [
        ("tetragonal", 22.5, [3, 2, 1, 2] * 4 + [3]),
        ("orthotropic", 45.0, [3, 2, 1, 2] * 2 + [3]),
        # Quarter turns repeat directions; there are no mirrors.
        ("chiral", 30.0, [3, 2, 1] * 4 + [3]),
        # Only n and −n have equal values.
        ("none", 60.0, [3, 2, 1] * 2 + [3]),
    ],
)
def test_full_circle(symmetry: str, step: float, expected: list[int]) -> None:
    given = np.radians([0.0, step, 2 * step])
    turn, values = full_circle(given, np.array([3.0, 2.0, 1.0]), symmetry)
    assert np.degrees(turn) == pytest.approx(step * np.arange(len(expected)))
    assert values == pytest.approx(expected)
