"""Discrete-shell bending, eqs. (4-6), and its coupling to stretch by a print on one face."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import ufl

from toros_fem.forms.jets import Jet, Scalar, Vector, by_vectors, compose, cross, dot, minus, total
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.forms.lines import Family, stretch_along

# Angle in rad from which on a fold resists closing more than a bend does.
STEEP = ufl.pi * 5 / 6
# Side of a steep edge in the plane of its mirror, which may turn to either.
EITHER = 2.0
# What is left of a closed fold in rad, so that its energy is finite.
CLOSED = 1e-9


@dataclass(frozen=True)
class Edges:
    """Constants of a triangle's three edges, as UFL coefficients.

    Attributes:
        tensors: Tᵢ in Λ = Σᵢ φᵢ Tᵢ, three (xx, yy, xy), in 1/m.
        rests: Angles without moment, three in rad; None if they are all zero.
        turns: Factors of the rotation unknowns in the angles, three in 1/m; None if there are no
            rotations.
        mirrors: Unit normals of the planes that mirror the flaps, zero without a mirror; None
            if nothing is mirrored.
        folds: 1 for an edge with a neighbour or a mirror, 0 for a free edge with a rotation, three;
            None if no free edge has a rotation.
        sides: 1 or −1 for an edge that is assembled steeper than `STEEP`, by the sign of its angle,
            `EITHER` where this is not known, 0 for the others, three; None if all are 0.
    """

    tensors: Sequence[Any]
    rests: Sequence[Any] | None = None
    turns: Sequence[Any] | None = None
    mirrors: Sequence[Any] | None = None
    folds: Any | None = None
    sides: Any | None = None

    def curvature(self, angles: Sequence[Scalar]) -> list[Scalar]:
        """Return Λ = Σᵢ φᵢ Tᵢ as (xx, yy, xy), in 1/m, from `edge_angles`."""
        pairs = list(zip(angles, self.tensors, strict=True))
        return [total(phi * T[k] for phi, T in pairs) for k in range(3)]


def edge_angles(t: Triangle, edges: Edges) -> list[Jet]:
    """Return φᵢ = θᵢ − θ⁰ᵢ + 2 sᵢ αᵢ of the three edges, in rad, eq. (4).

    With Tᵢ = n̄ᵢ n̄ᵢᵀ l̄ᵢ/(2 Ā) and no α, Λ = Σᵢ φᵢ Tᵢ is the triangle average of eq. (4); with
    rotations α of the edges, sᵢ = ±1 opposite in the two triangles of an edge, the mid-edge
    operator of Grinspun et al. 2006 (lowest-order Hellan-Herrmann-Johnson).
    """
    angles = []
    for i in range(3):
        a, b, c, d = (t.nodes[n] for n in ((i + 1) % 3, (i + 2) % 3, i, 3 + i))
        if edges.mirrors is not None:
            d = reflected(d, a, edges.mirrors[i])
        angle = fold(a, b, c, d, None if edges.sides is None else edges.sides[i])
        if edges.folds is not None:
            angle = angle * edges.folds[i]
        if edges.rests is not None:
            angle = angle - edges.rests[i]
        if edges.turns is not None:
            angle = angle + t.nodes[6][i] * edges.turns[i]
        angles.append(angle)
    return angles


def fold(a: Vector, b: Vector, c: Vector, d: Vector, side: Any | None = None) -> Jet:
    """Return the dihedral angle at edge a-b of triangles (a, b, c) and (b, a, d), in rad.

    The angle is the full one in the deformed skin, 0 where it is flat, positive where the
    triangles fold away from their normals. It uses atan2, since acos loses half the digits near 0.
    It is `stopped` about 0; with `side` 1 or −1 about ±90°, so that a fold may begin at ±180°, and
    an assembly that turns inside out comes back; with `EITHER` it jumps at ±180°.
    """
    turned, ending = (ufl.atan2, stopped) if side is None else _from_side(side)

    def of_edges(u: Vector, v: Vector, w: Vector) -> Jet:
        length = compose(ufl.sqrt, [dot(u, u)])
        sine = -length * dot(u, cross(v, w))
        cosine = dot(u, w) * dot(u, v) - dot(u, u) * dot(v, w)
        return compose(ending, [compose(turned, [sine, cosine])])

    return by_vectors(of_edges, minus(b, a), minus(c, a), minus(d, a))


def _from_side(side: Any) -> tuple[Callable[[Any, Any], Any], Callable[[Any], Any]]:
    """Return the laws of an angle from ±90°, by its sine and cosine, and of its end."""
    way = ufl.conditional(ufl.eq(side, EITHER), 0.0, side)

    def turned(sine: Any, cosine: Any) -> Any:
        ahead = 1 - abs(way)  # from the angle's own direction, or from that of ±90°
        return ufl.atan2(ahead * sine - way * cosine, ahead * cosine + way * sine)

    def ending(angle: Any) -> Any:
        ends = ufl.conditional(ufl.eq(side, EITHER), angle, stopped(angle))
        return ends + way * ufl.pi / 2

    return turned, ending


def stopped(angle: Any) -> Any:
    """Return an angle in rad that grows beyond itself above `STEEP`, without bound towards π.

    An energy of the angle alone jumps at π, where a fold turns inside out, and has a minimum there
    that no Newton step finds. With e = |θ| − `STEEP`, e³/((π − `STEEP`)(π − |θ|)) is added, which
    has two continuous derivatives.
    """
    room = ufl.pi - STEEP
    beyond = ufl.conditional(ufl.gt(abs(angle), STEEP), abs(angle) - STEEP, 0.0)
    return angle + ufl.sign(angle) * beyond**3 / (room * (room - beyond + CLOSED))


def reflected(at: Vector, through: Vector, normal: Any) -> Vector:
    """Return a point mirrored at the plane through another one; a zero normal leaves it."""
    m = [normal[k] for k in range(3)]
    twice = dot(minus(at, through), m) * 2
    return at[0] - twice * m[0], at[1] - twice * m[1], at[2] - twice * m[2]


def bending_energy(Lambda: Sequence[Scalar], mu: Any, lam: Any) -> Any:
    """Return ½ Λ:D:Λ per flat area, plane-stress Hooke, eqs. (5, 6), in J/m².

    With Lamé parameters times h³/12, in N m, it is the integral of ½ ε·D·ε over the thickness, ε =
    −z Λ.
    """
    xx, yy, xy = Lambda
    return lam / 2 * (xx + yy) ** 2 + mu * (xx**2 + yy**2 + 2 * xy**2)


def coupling_energy(e: Strain, Lambda: Sequence[Scalar], mu: Any, lam: Any) -> Any:
    """Return E:B:Λ per flat area in J/m², plane-stress Hooke.

    E = U − 1 is the Biot strain of the fabric's mid-surface; U = (C + p I)/s. At the distance z
    along the normal the strain is E + zΛ, as in eq. (5) with z against the normal. Lamé parameters
    are times thickness and offset, in N.
    """
    xx, yy, xy = Lambda
    E = [(e.C[0] + e.p) / e.s - 1, (e.C[1] + e.p) / e.s - 1, e.C[2] / e.s]
    return lam * e.total * (xx + yy) + 2 * mu * (E[0] * xx + E[1] * yy + 2 * E[2] * xy)


def coupling_of_lines(families: Sequence[Family], e: Strain, Lambda: Sequence[Scalar]) -> Any:
    """Return the same of lines, whose strain is |F d| − 1 + z d·Λ d.

    Their `stretching` is times the offset, in N.
    """
    xx, yy, xy = Lambda
    return total(
        f.stretching
        * (stretch_along(f, e.C) - 1)
        * ((1 + f.cosine) / 2 * xx + (1 - f.cosine) / 2 * yy + f.sine * xy)
        for f in families
    )
