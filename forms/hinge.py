"""Angle at an edge between two triangles, with its first and second derivatives."""

from __future__ import annotations

from typing import Any

import ufl

from toros_fem.forms.blocks import Vector, dot, matrix_product, minus, times

# Derivative of the edge a-b of a triangle (a, b, c) by its corners.
ALONG = (-1, 1, 0)

Matrix = list[list[Any]]


def hinge(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, tuple[Any, Any, Any, Any]]:
    """Return the dihedral angle at edge a-b of triangles (a, b, c), (b, a, d) and its gradient.

    The angle is the full one in the deformed skin, 0 where it is flat, positive where the
    triangles fold away from their normals. It uses atan2, since acos loses half the digits near 0.

    Returns:
        The angle in rad, and its gradient at a, b, c, d in rad/m: the closed form of Grinspun
        et al. 2003 and Tamstorf & Grinspun 2013, equal to the automatic one to rounding, but
        far cheaper to compile and to differentiate again.
    """
    e = b - a
    length = ufl.sqrt(ufl.inner(e, e))
    n1, n2 = ufl.cross(e, c - a), ufl.cross(-e, d - b)
    angle = ufl.atan2(ufl.inner(ufl.cross(n1, n2), e / length), ufl.inner(n1, n2))
    m1, m2 = n1 / ufl.inner(n1, n1), n2 / ufl.inner(n2, n2)
    at_a = -(ufl.inner(c - b, e) * m1 + ufl.inner(d - b, e) * m2) / length
    at_b = (ufl.inner(c - a, e) * m1 + ufl.inner(d - a, e) * m2) / length
    return angle, (at_a, at_b, -length * m1, -length * m2)


class HalfHinge:
    """One of the two triangles (a, b, c) at an edge a-b, and its part in the angle's derivatives.

    With l the edge's length, h the height of c over it, α where that height's foot divides it,
    e, n, m unit vectors along the edge, along the normal and along the height, and weights
    w = (1 − α, α, −1), r = (−1, 1, 0) of a, b, c, the angle's gradient is Σ w_v n / h and its
    Hessian has the blocks

        (w_u w_v / h² + r_u r_v / (2 l²)) (n mᵀ + m nᵀ) − (r_u w_v n eᵀ + w_u r_v e nᵀ) / (h l),

    summed over both halves: the closed form of Tamstorf & Grinspun 2013, split differently.

    Args:
        a, c: First end of the edge, and the corner beside it.
        normal: e × (c − a), or its negative for the second half.
        edge: b − a.
    """

    def __init__(self, a: Vector, c: Vector, normal: Vector, edge: Vector) -> None:
        inverse_area = 1 / ufl.sqrt(dot(normal, normal))
        self.inverse_length = 1 / ufl.sqrt(dot(edge, edge))
        self.inverse_height = dot(edge, edge) * self.inverse_length * inverse_area
        self.n = times(inverse_area, normal)
        self.e = times(self.inverse_length, edge)
        alpha = dot(minus(c, a), edge) * self.inverse_length * self.inverse_length
        foot = tuple(c[k] - a[k] - alpha * edge[k] for k in range(3))
        self.m = times(self.inverse_height, foot)  # type: ignore[arg-type]
        self.w = (1 - alpha, alpha, -1)

    def gradient(self, v: int) -> Vector:
        """Return the gradient of the angle at corner v of (a, b, c)."""
        return times(self.w[v] * self.inverse_height, self.n)

    def hessian(self, factor: Any) -> dict[tuple[int, int], Matrix]:
        """Return a factor times the angle's Hessian, blocks (u, v) with u ≤ v of (a, b, c)."""
        n, m, e = self.n, self.m, self.e
        plane = [[n[k] * m[j] + m[k] * n[j] for j in range(3)] for k in range(3)]
        mixed = [[n[k] * e[j] for j in range(3)] for k in range(3)]
        by_both = factor * self.inverse_height * self.inverse_length
        by_height = factor * self.inverse_height * self.inverse_height
        by_length = factor * self.inverse_length * self.inverse_length / 2
        blocks = {}
        for u in range(3):
            for v in range(u, 3):
                bend = by_height * self.w[u] * self.w[v]
                if ALONG[u] * ALONG[v]:
                    bend = bend + ALONG[u] * ALONG[v] * by_length
                slide = by_both * ALONG[u] * self.w[v] if ALONG[u] else 0
                turn = by_both * ALONG[v] * self.w[u] if ALONG[v] else 0
                blocks[u, v] = [
                    [
                        bend * plane[k][j] - slide * mixed[k][j] - turn * mixed[j][k]
                        for j in range(3)
                    ]
                    for k in range(3)
                ]
        return blocks


def reflected(at: Any, through: Any, normal: Any) -> Any:
    """Return a UFL vector mirrored at the plane through a point; a zero normal leaves it."""
    return at - 2 * ufl.inner(normal, at - through) * normal


class Mirror:
    """Chain rule from a mirrored flap d = R d' + P a to d' and a.

    P = 2 m mᵀ, R = 1 − P, with m the unit normal of a plane through a, or zero.

    Args:
        normal: m.
    """

    def __init__(self, normal: Vector) -> None:
        self._m = normal
        self._P = [[2 * normal[k] * normal[j] for j in range(3)] for k in range(3)]
        self._R = [[(k == j) - self._P[k][j] for j in range(3)] for k in range(3)]

    def place(self, at: Vector, through: Vector) -> Vector:
        """Return the mirrored flap."""
        away = times(2 * dot(minus(at, through), self._m), self._m)
        return minus(at, away)

    def gradient(self, by_flap: Vector) -> tuple[Vector, Vector]:
        """Return the derivatives by d' and by a from that by d."""
        to_a = times(2 * dot(by_flap, self._m), self._m)
        return minus(by_flap, to_a), to_a

    def hessian(self, blocks: dict[tuple[int, int], Matrix]) -> dict[tuple[int, int], Matrix]:
        """Return blocks (u, v) of (a, b, d) as those of (a, b, d')."""
        R, P = self._R, self._P
        ad, bd, dd = blocks[0, 2], blocks[1, 2], blocks[2, 2]
        P_dd, ad_P = matrix_product(P, dd), matrix_product(ad, P)
        by_a = [[ad[k][j] + P_dd[k][j] for j in range(3)] for k in range(3)]
        P_dd_P = matrix_product(P_dd, P)
        aa = [[blocks[0, 0][k][j] + ad_P[k][j] + ad_P[j][k] + P_dd_P[k][j] for j in range(3)]
              for k in range(3)]  # fmt: skip
        P_db = matrix_product(P, [list(row) for row in zip(*bd, strict=True)])
        ab = [[blocks[0, 1][k][j] + P_db[k][j] for j in range(3)] for k in range(3)]
        return {
            (0, 0): aa,
            (0, 1): ab,
            (1, 1): blocks[1, 1],
            (0, 2): matrix_product(by_a, R),
            (1, 2): matrix_product(bd, R),
            (2, 2): matrix_product(matrix_product(R, dd), R),
        }
