"""Discrete-shell bending by triangle-averaged curvature, eqs. (4-6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl
from toros_fem.forms.blocks import Blocks, Vector, cross, dot, minus, times
from toros_fem.forms.kinematics import edges_of, flat_area

# How the edge a-b of a triangle (a, b, c) changes with its corners.
ALONG = (-1, 1, 0)


def hinge(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, tuple[Any, Any, Any, Any]]:
    """Dihedral angle at edge a-b between triangles (a, b, c) and (b, a, d), and its gradient.

    The angle is the full one in the deformed skin, 0 where it is flat, positive where the
    triangles fold away from their normals. By atan2: acos loses half the digits near 0.

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


def curvature(
    patch: Sequence[Any], direction: Sequence[Any], jacobian: Any, has_flap: Sequence[Any]
) -> tuple[Any, Any]:
    """Averaged curvature Λ of a triangle and its variation, eq. (4).

    Λ = Σᵢ θᵢ/(2 Ā l̄ᵢ) t̄ᵢ t̄ᵢᵀ over the three edges.

    Args:
        patch: Deformed positions of the three corners and of the three flap vertices; flap i
            lies across edge i.
        direction: The same of a variation of the positions (a test function's parts).
        jacobian: Jacobian of the flat chart.
        has_flap: For each edge 1 where it has a neighbour, else 0: a free edge carries no angle.

    Returns:
        Λ and δΛ, shape (2, 2), in 1/m.
    """
    area = flat_area(jacobian)
    value, variation = 0, 0
    for i, edge in enumerate(edges_of(jacobian)):
        j, k = (i + 1) % 3, (i + 2) % 3
        normal = ufl.as_vector([edge[1], -edge[0]])
        weight = has_flap[i] / (2 * area * ufl.sqrt(ufl.inner(edge, edge)))
        angle, gradient = hinge(patch[j], patch[k], patch[i], patch[3 + i])
        nodes = (j, k, i, 3 + i)
        change = sum(ufl.inner(g, direction[n]) for g, n in zip(gradient, nodes, strict=True))
        value += weight * angle * ufl.outer(normal, normal)
        variation += weight * change * ufl.outer(normal, normal)
    return value, variation


def moment(Lambda: Any, mu: Any, lam: Any) -> Any:
    """Bending moment D:Λ, plane-stress Hooke, eqs. (5, 6), in N.

    Args:
        Lambda: Curvature, in 1/m.
        mu, lam: Plane-stress Lamé parameters times h³/12, in N m.
    """
    return lam * ufl.tr(Lambda) * ufl.Identity(2) + 2 * mu * Lambda


def bending_energy(Lambda: Any, mu: Any, lam: Any) -> Any:
    """½ Λ:D:Λ per flat area, eqs. (5, 6), in J/m².

    With mu and lam times h³/12 it is the integral of ½ ε·D·ε over the thickness, ε = −z Λ.
    """
    return ufl.inner(moment(Lambda, mu, lam), Lambda) / 2


class HalfHinge:
    """One of the two triangles (a, b, c) at an edge a-b: what its angle to the other varies by.

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
        """Gradient of the angle at corner v of (a, b, c)."""
        return times(self.w[v] * self.inverse_height, self.n)

    def add_hessian(self, blocks: Blocks, nodes: Sequence[int], factor: Any) -> None:
        """Add factor times the angle's Hessian at the given nodes of the patch."""
        n, m, e = self.n, self.m, self.e
        plane = [[n[k] * m[j] + m[k] * n[j] for j in range(3)] for k in range(3)]
        mixed = [[n[k] * e[j] for j in range(3)] for k in range(3)]
        by_both = factor * self.inverse_height * self.inverse_length
        by_height = factor * self.inverse_height * self.inverse_height
        by_length = factor * self.inverse_length * self.inverse_length / 2
        for u in range(3):
            for v in range(u, 3):
                bend = by_height * self.w[u] * self.w[v]
                if ALONG[u] * ALONG[v]:
                    bend = bend + ALONG[u] * ALONG[v] * by_length
                slide = by_both * ALONG[u] * self.w[v] if ALONG[u] else 0
                turn = by_both * ALONG[v] * self.w[u] if ALONG[v] else 0
                block = [
                    [
                        bend * plane[k][j] - slide * mixed[k][j] - turn * mixed[j][k]
                        for j in range(3)
                    ]
                    for k in range(3)
                ]
                # The upper triangle is kept by node number, not by corner.
                if nodes[u] <= nodes[v]:
                    blocks.add(nodes[u], nodes[v], block)
                else:
                    blocks.add(nodes[v], nodes[u], [list(row) for row in zip(*block, strict=True)])


def bending_blocks(
    blocks: Blocks,
    patch: Sequence[Vector],
    jacobian: Any,
    has_flap: Sequence[Any],
    stiffness: tuple[Any, Any],
    geometric: Any,
) -> None:
    """Add the second variation of ½ Λ:D:Λ, eqs. (4-6), per flat area.

    With Λ = Σᵢ θᵢ Tᵢ the energy is quadratic in the three angles, so that its second variation is
    Σᵢⱼ Kᵢⱼ ∇θᵢ ∇θⱼᵀ + Σᵢ Mᵢ ∇∇θᵢ with Kᵢⱼ = Tᵢ:D:Tⱼ and the moments Mᵢ = Σⱼ Kᵢⱼ θⱼ.

    Args:
        blocks: Receives the blocks of corners 0 to 2 and flaps 3 to 5.
        patch: Deformed corners and flaps.
        jacobian: Jacobian of the flat chart.
        has_flap: For each edge 1 where it has a neighbour, else 0.
        stiffness: Plane-stress Lamé parameters times h³/12.
    """
    mu, lam = stiffness
    area = flat_area(jacobian)
    normals, weights, angles, halves, nodes = [], [], [], [], []
    for i, flat in enumerate(edges_of(jacobian)):
        j, k = (i + 1) % 3, (i + 2) % 3
        normals.append((flat[1], -flat[0]))
        weights.append(has_flap[i] / (2 * area * ufl.sqrt(flat[0] ** 2 + flat[1] ** 2)))
        a, b, c, d = patch[j], patch[k], patch[i], patch[3 + i]
        edge = minus(b, a)
        first = HalfHinge(a, c, cross(edge, minus(c, a)), edge)
        second = HalfHinge(a, d, cross(minus(d, b), edge), edge)
        angles.append(ufl.atan2(dot(cross(first.n, second.n), first.e), dot(first.n, second.n)))
        halves.append((first, second))
        nodes.append((j, k, i, 3 + i))

    def coupling(i: int, j: int) -> Any:
        (a0, a1), (b0, b1) = normals[i], normals[j]
        traces = (a0 * a0 + a1 * a1) * (b0 * b0 + b1 * b1)
        double = (a0 * b0 + a1 * b1) * (a0 * b0 + a1 * b1)
        return weights[i] * weights[j] * (lam * traces + 2 * mu * double)

    K = {(i, j): coupling(i, j) for i in range(3) for j in range(i, 3)}
    K.update({(j, i): value for (i, j), value in K.items()})
    gradient: list[dict[int, Vector]] = []
    for i, (first, second) in enumerate(halves):
        j, k, own, flap = nodes[i]
        gradient.append(
            {
                j: tuple(x + y for x, y in zip(first.gradient(0), second.gradient(0), strict=True)),
                k: tuple(x + y for x, y in zip(first.gradient(1), second.gradient(1), strict=True)),
                own: first.gradient(2),
                flap: second.gradient(2),
            }  # type: ignore[dict-item]
        )
        bending_moment = geometric * sum(K[i, other] * angles[other] for other in range(3))
        first.add_hessian(blocks, (j, k, own), bending_moment)
        second.add_hessian(blocks, (j, k, flap), bending_moment)
    for v in range(6):
        # K times the gradients, once for each column
        column = [
            [
                sum(K[i, j] * gradient[j][v][m] for j in range(3) if v in gradient[j])
                for i in range(3)
            ]
            for m in range(3)
        ]
        for u in range(v + 1):
            block = [
                [
                    sum(gradient[i][u][k] * column[m][i] for i in range(3) if u in gradient[i])
                    for m in range(3)
                ]
                for k in range(3)
            ]
            blocks.add(u, v, block)
