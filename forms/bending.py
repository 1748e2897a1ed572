"""Discrete-shell bending by triangle-averaged curvature, eqs. (4-6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl
from toros_fem.forms.kinematics import edges_of, flat_area


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
