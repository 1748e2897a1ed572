"""Element matrices of second variations by hand, entry by entry.

They equal the expansion of `ufl.derivative` to rounding (tests/forms). They are 3×3 blocks over a
triangle's nodes, with vectors as tuples of scalar expressions: common subexpressions are then
computed once in FFCx's code, and only the upper half is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Vector = tuple[Any, Any, Any]
# 3×3 blocks of a triangle's edges from its first corner: (0, 0), (0, 1) and (1, 1).
EdgePairs = dict[tuple[int, int], list[list[Any]]]


class Blocks:
    """3×3 blocks (u, v), u ≤ v, of a symmetric matrix over a triangle's nodes."""

    def __init__(self, nodes: int) -> None:
        self.nodes = nodes
        self._entries: dict[tuple[int, int], Any] = {}

    def add(self, u: int, v: int, block: Sequence[Sequence[Any]]) -> None:
        """Add a block at (u, v); add exactly one of the pair (u, v), (v, u)."""
        for k in range(3):
            for m in range(3):
                row, column = 3 * u + k, 3 * v + m
                if u == v and row > column:
                    continue
                key = (row, column) if row <= column else (column, row)
                old = self._entries.get(key)
                self._entries[key] = block[k][m] if old is None else old + block[k][m]

    def add_edges(self, H: EdgePairs) -> None:
        """Add what is given by the edges e₁, e₂ of corners 0 to 2 from the first one."""
        self.add(1, 1, H[0, 0])
        self.add(1, 2, H[0, 1])
        self.add(2, 2, H[1, 1])
        # Shifting the whole triangle costs nothing: the first corner's blocks follow.
        first = [[-(H[0, 0][k][m] + H[0, 1][m][k]) for m in range(3)] for k in range(3)]
        second = [[-(H[0, 1][k][m] + H[1, 1][k][m]) for m in range(3)] for k in range(3)]
        self.add(0, 1, first)
        self.add(0, 2, second)
        self.add(0, 0, [[-(first[k][m] + second[k][m]) for m in range(3)] for k in range(3)])

    def upper(self) -> list[Any]:
        """Return the entries (i, j), i ≤ j, row by row."""
        size = 3 * self.nodes
        return [self._entries.get((i, j), 0) for i in range(size) for j in range(i, size)]


def sum_of_pairs(one: EdgePairs, two: EdgePairs) -> EdgePairs:
    """Return the sum of two sets of edge pairs."""
    return {
        pair: [[block[k][m] + two[pair][k][m] for m in range(3)] for k in range(3)]
        for pair, block in one.items()
    }


def balanced_sum(terms: Sequence[Any]) -> Any:
    """Return the sum of at least one term as a balanced tree, since UFL recurses into sums."""
    if len(terms) == 1:
        return terms[0]
    half = len(terms) // 2
    return balanced_sum(terms[:half]) + balanced_sum(terms[half:])


def components(vector: Any) -> Vector:
    """Return the three components of a UFL vector."""
    return vector[0], vector[1], vector[2]


def minus(a: Vector, b: Vector) -> Vector:
    """Return a − b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def plus(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def times(factor: Any, a: Vector) -> Vector:
    """Return a multiple of a vector."""
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Vector, b: Vector) -> Any:
    """Return a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def matrix_product(a: Sequence[Sequence[Any]], b: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """Return the product of two 3×3 matrices."""
    return [[sum(a[k][n] * b[n][j] for n in range(3)) for j in range(3)] for k in range(3)]


def skew(a: Vector) -> list[list[Any]]:
    """Return the matrix of x ↦ a × x."""
    return [[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]]
