"""Enclosed volume and its second variation."""

import numpy as np
import pytest
from helpers.expressions import matrix, number, vector

from toros_fem.forms.blocks import Blocks
from toros_fem.forms.pressure import enclosed_volume, pressure_blocks

FLAT = np.array([[0.0, 0.0], [2.0, 0.0], [0.5, 1.5]])
JACOBIAN = np.column_stack([FLAT[1] - FLAT[0], FLAT[2] - FLAT[0]])


def test_volume_of_a_tetrahedron_wherever_the_origin_is() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], dtype=float)
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    for origin in (np.zeros(3), np.array([5.0, -4.0, 7.0])):
        moved = corners + origin
        parts = [number(enclosed_volume([vector(moved[k]) for k in face])) for face in faces]
        assert sum(parts) == pytest.approx(1.0, rel=1e-12)


def test_second_variation_of_the_volume_by_differences() -> None:
    """−P V of one triangle is a polynomial of degree one in each corner: differences are exact."""
    x = np.random.default_rng(1).standard_normal((3, 3))
    pressure, area = 7.0, 1.5
    blocks = Blocks(3)
    pressure_blocks(blocks, [tuple(p) for p in x], matrix(JACOBIAN), pressure)
    upper = np.zeros((9, 9))
    upper[np.triu_indices(9)] = [number(entry) for entry in blocks.upper()]

    def energy(at: np.ndarray) -> float:
        a, b, c = at.reshape(3, 3)
        return float(-pressure * a @ np.cross(b, c) / 6 / area)

    base, unit = x.ravel(), np.eye(9)
    for i in range(9):
        for j in range(i + 1, 9):
            expected = (
                energy(base + unit[i] + unit[j]) - energy(base + unit[i])
                - energy(base + unit[j]) + energy(base)
            )  # fmt: skip
            assert upper[i, j] == pytest.approx(expected, abs=1e-12)
