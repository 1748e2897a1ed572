"""Blocks of symmetric matrices, and vectors as tuples, on numbers."""

import numpy as np
import pytest

from toros_fem.forms.blocks import (
    Blocks,
    Vector,
    balanced_sum,
    cross,
    dot,
    matrix_product,
    minus,
    plus,
    skew,
    times,
)

A, B = (1.0, -2.0, 0.5), (0.3, 4.0, -1.0)


def rows(matrix: np.ndarray) -> list[list[float]]:
    return [[float(entry) for entry in row] for row in matrix]


def test_upper_triangle_of_added_blocks() -> None:
    """Blocks that are added at (u, v) or at (v, u) make the same symmetric matrix."""
    rng = np.random.default_rng(0)
    whole = rng.standard_normal((6, 6))
    whole += whole.T
    blocks = Blocks(2)
    for u, v in ((0, 0), (1, 0), (1, 1)):  # (1, 0): below the diagonal
        blocks.add(u, v, rows(whole[3 * u : 3 * u + 3, 3 * v : 3 * v + 3]))
    assert blocks.upper() == pytest.approx(whole[np.triu_indices(6)])
    blocks.add(0, 1, rows(whole[:3, 3:]))
    double = whole.copy()
    double[:3, 3:] *= 2
    assert blocks.upper() == pytest.approx(double[np.triu_indices(6)])


def test_entries_without_a_block_are_zero() -> None:
    blocks = Blocks(2)
    blocks.add(0, 0, rows(np.eye(3)))
    assert sum(blocks.upper()) == 3
    assert len(blocks.upper()) == 21


@pytest.mark.parametrize("count", [1, 2, 7])
def test_balanced_sum(count: int) -> None:
    assert balanced_sum(list(range(1, count + 1))) == count * (count + 1) // 2


def test_vectors() -> None:
    a, b = np.array(A), np.array(B)

    def same(one: Vector, other: np.ndarray) -> bool:
        return bool(np.allclose(one, other, rtol=1e-15))

    assert same(plus(A, B), a + b)
    assert same(minus(A, B), a - b)
    assert same(times(3.0, A), 3 * a)
    assert same(cross(A, B), np.cross(a, b))
    assert dot(A, B) == pytest.approx(a @ b)
    assert np.array(skew(A)) @ b == pytest.approx(np.cross(a, b))
    one, two = np.arange(9.0).reshape(3, 3), np.ones((3, 3)) + np.eye(3)
    assert np.array(matrix_product(rows(one), rows(two))) == pytest.approx(one @ two)
