"""Discrete-shell bending: curvature from the angles at a triangle's edges, eqs. (4-6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ufl

from toros_fem.forms.blocks import Blocks, Vector, components, cross, dot, minus, plus, times
from toros_fem.forms.eccentric import Offset, coupled_moments
from toros_fem.forms.hinge import HalfHinge, Mirror, hinge, reflected

NOTHING: Vector = (0, 0, 0)
# Rows of a symmetric 3×3 matrix over (xx, yy, xy).
Symmetric = Sequence[Vector]


@dataclass(frozen=True)
class Edges:
    """Constants of a triangle's three edges, as UFL coefficients.

    Attributes:
        tensors: Tᵢ in Λ = Σᵢ θᵢ Tᵢ, three (xx, yy, xy), in 1/m.
        rests: Angles without moment, three in rad; None if they are all zero.
        turns: Factors of the rotation unknowns in the angles, three in 1/m; None if there are no
            rotations.
        mirrors: Unit normals of the planes that mirror the flaps, zero without a mirror; None
            if nothing is mirrored.
        folds: 1 for an edge with a neighbour or a mirror, 0 for a free edge with a rotation, three;
            None if no free edge has a rotation.
    """

    tensors: Sequence[Any]
    rests: Sequence[Any] | None = None
    turns: Sequence[Any] | None = None
    mirrors: Sequence[Any] | None = None
    folds: Any | None = None


def curvature(patch: Sequence[Any], direction: Sequence[Any], edges: Edges) -> tuple[Any, Any]:
    """Return the curvature Λ of a triangle and its variation, eq. (4).

    Λ = Σᵢ (θᵢ − θ⁰ᵢ + 2 sᵢ αᵢ) Tᵢ over the three edges. With Tᵢ = n̄ᵢ n̄ᵢᵀ l̄ᵢ/(2 Ā) and no α it is
    the triangle average of eq. (4); with rotations α of the edges, sᵢ = ±1 opposite in the two
    triangles of an edge, the mid-edge operator of Grinspun et al. 2006 (lowest-order
    Hellan-Herrmann-Johnson); with other Tᵢ the quadratic through the patch (Flores & Oñate 2005).

    The variation is written by hand, from the angles' gradients in closed form; tests/forms ties
    it to `ufl.derivative` of the energy.

    Args:
        patch: Deformed positions of the three corners and of the three flap vertices; flap i
            lies across edge i. Then, if there are any, the rotation unknowns as one vector.
        direction: The same parts of a variation (a test function).
        edges: Constants of the edges.

    Returns:
        Λ and δΛ, shape (2, 2), in 1/m.
    """
    value, variation = 0, 0
    for i, parts in enumerate(edges.tensors):
        j, k = (i + 1) % 3, (i + 2) % 3
        flap, change_of_flap = patch[3 + i], direction[3 + i]
        if edges.mirrors is not None:
            flap = reflected(flap, patch[j], edges.mirrors[i])
            change_of_flap = reflected(change_of_flap, direction[j], edges.mirrors[i])
        angle, gradient = hinge(patch[j], patch[k], patch[i], flap)
        changes = (direction[j], direction[k], direction[i], change_of_flap)
        change = sum(ufl.inner(g, d) for g, d in zip(gradient, changes, strict=True))
        if edges.folds is not None:
            angle, change = edges.folds[i] * angle, edges.folds[i] * change
        if edges.rests is not None:
            angle -= edges.rests[i]
        if edges.turns is not None:
            angle += edges.turns[i] * patch[6][i]
            change += edges.turns[i] * direction[6][i]
        tensor = ufl.as_matrix([[parts[0], parts[2]], [parts[2], parts[1]]])
        value += angle * tensor
        variation += change * tensor
    return value, variation


def moment(Lambda: Any, mu: Any, lam: Any, lines: Symmetric | None = None) -> Any:
    """Return the bending moment D:Λ, plane-stress Hooke, eqs. (5, 6), in N.

    Args:
        Lambda: Curvature, in 1/m.
        mu, lam: Plane-stress Lamé parameters times h³/12, in N m.
        lines: Stiffness of lines on the sheet, `bending_stiffness`; None for none.
    """
    sheet = lam * ufl.tr(Lambda) * ufl.Identity(2) + 2 * mu * Lambda
    if lines is None:
        return sheet
    xx, yy, xy = _product(lines, (Lambda[0, 0], Lambda[1, 1], Lambda[0, 1]))
    return sheet + ufl.as_matrix([[xx, xy / 2], [xy / 2, yy]])


def bending_energy(Lambda: Any, mu: Any, lam: Any, lines: Symmetric | None = None) -> Any:
    """Return ½ Λ:D:Λ per flat area, eqs. (5, 6), in J/m².

    With mu and lam times h³/12 it is the integral of ½ ε·D·ε over the thickness, ε = −z Λ.
    """
    return ufl.inner(moment(Lambda, mu, lam, lines), Lambda) / 2


def _product(D: Symmetric, Lambda: Vector) -> Vector:
    """Return D Λ over (xx, yy, xy)."""
    return dot(D[0], Lambda), dot(D[1], Lambda), dot(D[2], Lambda)


def bending_blocks(
    blocks: Blocks,
    patch: Sequence[Any],
    edges: Edges,
    stiffness: tuple[Any, Any],
    geometric: Any,
    lines: Symmetric | None = None,
    offset: Offset | None = None,
    jacobian: Any | None = None,
) -> None:
    """Add the second variation of ½ Λ:D:Λ, eqs. (4-6), and of E:B:Λ, per flat area.

    With Λ = Σᵢ φᵢ Tᵢ, φᵢ = θᵢ − θ⁰ᵢ + 2 sᵢ αᵢ, the energy is quadratic in the three φ. Its second
    variation is Σᵢⱼ Kᵢⱼ ∇φᵢ ∇φⱼᵀ + Σᵢ Mᵢ ∇∇θᵢ with Kᵢⱼ = Tᵢ:D:Tⱼ and the moments Mᵢ = Σⱼ Kᵢⱼ φⱼ.
    That of E:B:Λ = Σᵢ φᵢ Nᵢ, Nᵢ = Tᵢ:B:E, is Σᵢ (∇Nᵢ ∇φᵢᵀ + ∇φᵢ ∇Nᵢᵀ + Nᵢ ∇∇θᵢ + φᵢ ∇∇Nᵢ).

    Args:
        blocks: Receives the blocks of corners 0 to 2, flaps 3 to 5 and rotations 6.
        patch: As in `curvature`.
        edges: Constants of the edges.
        stiffness: Plane-stress Lamé parameters times h³/12.
        geometric: 1 for all, 0 for the first sum alone, which is positive by itself.
        lines: As in `moment`.
        offset: Print beside the fabric's middle; None for none.
        jacobian: Jacobian of the flat chart, which an offset needs.
    """
    mu, lam = stiffness
    x = [components(node) for node in patch]
    mirrors = (
        [Mirror(components(m)) for m in edges.mirrors] if edges.mirrors is not None else [None] * 3
    )
    angles, halves, nodes = [], [], []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        a, b, c, d = x[j], x[k], x[i], x[3 + i]
        mirror = mirrors[i]
        if mirror is not None:
            d = mirror.place(d, a)
        edge = minus(b, a)
        first = HalfHinge(a, c, cross(edge, minus(c, a)), edge)
        second = HalfHinge(a, d, cross(minus(d, b), edge), edge)
        angle = ufl.atan2(dot(cross(first.n, second.n), first.e), dot(first.n, second.n))
        if edges.folds is not None:
            angle = edges.folds[i] * angle
        if edges.rests is not None:
            angle = angle - edges.rests[i]
        if edges.turns is not None:
            angle = angle + edges.turns[i] * x[6][i]
        angles.append(angle)
        halves.append((first, second))
        nodes.append((j, k, i, 3 + i))

    K = {}
    by_lines = [] if lines is None else [_product(lines, components(t)) for t in edges.tensors]
    for i, one in enumerate(edges.tensors):
        for j, two in enumerate(edges.tensors):
            if i <= j:
                traces = (one[0] + one[1]) * (two[0] + two[1])
                double = one[0] * two[0] + one[1] * two[1] + 2 * one[2] * two[2]
                K[i, j] = K[j, i] = lam * traces + 2 * mu * double
                if lines is not None:
                    K[i, j] = K[j, i] = K[i, j] + dot(components(one), by_lines[j])

    coupled = None
    if offset is not None:
        whole = offset.weighted(geometric)
        coupled = coupled_moments(x[:3], jacobian, edges.tensors, angles, whole)
        blocks.add_edges(coupled.pairs)

    gradient: list[dict[int, Vector]] = []
    for i, (first, second) in enumerate(halves):
        j, k, own, flap = nodes[i]
        bending_moment = geometric * sum(K[i, other] * angles[other] for other in range(3))
        if coupled is not None:
            bending_moment = bending_moment + coupled.values[i]
        if edges.folds is not None:
            bending_moment = edges.folds[i] * bending_moment
        by_flap, by_a = second.gradient(2), NOTHING
        one, two = first.hessian(bending_moment), second.hessian(bending_moment)
        mirror = mirrors[i]
        if mirror is not None:
            by_flap, by_a = mirror.gradient(by_flap)
            two = mirror.hessian(two)
        for half, corners in ((one, (j, k, own)), (two, (j, k, flap))):
            for (u, v), block in half.items():
                blocks.add(corners[u], corners[v], block)
        by_edge = {
            j: plus(plus(first.gradient(0), second.gradient(0)), by_a),
            k: plus(first.gradient(1), second.gradient(1)),
            own: first.gradient(2),
            flap: by_flap,
        }
        if edges.folds is not None:
            by_edge = {node: times(edges.folds[i], part) for node, part in by_edge.items()}
        if edges.turns is not None:
            parts = [edges.turns[i] if i == n else 0 for n in range(3)]
            by_edge[6] = (parts[0], parts[1], parts[2])
        gradient.append(by_edge)
    by_strain = {
        (i, v): coupled.gradients[i][v] for i in range(3) for v in range(3) if coupled is not None
    }
    for v in range(len(x)):
        # K times the gradients, once for each column
        column = [
            [
                sum(K[i, j] * gradient[j][v][m] for j in range(3) if v in gradient[j])
                + (by_strain[i, v][m] if (i, v) in by_strain else 0)
                for i in range(3)
            ]
            for m in range(3)
        ]
        for u in range(v + 1):
            block = [
                [
                    sum(gradient[i][u][k] * column[m][i] for i in range(3) if u in gradient[i])
                    + sum(
                        by_strain[i, u][k] * gradient[i][v][m]
                        for i in range(3)
                        if (i, u) in by_strain and v in gradient[i]
                    )
                    for m in range(3)
                ]
                for k in range(3)
            ]
            blocks.add(u, v, block)
