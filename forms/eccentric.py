"""Print on one face of the fabric: coupling of membrane strain and curvature by its offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ufl

from toros_fem.forms.blocks import (
    EdgePairs,
    Vector,
    balanced_sum,
    components,
    dot,
    minus,
    plus,
    times,
)
from toros_fem.forms.kinematics import stretch_invariants
from toros_fem.forms.lines import Family


@dataclass(frozen=True)
class Offset:
    """Membrane stiffness times offset along the normal of what lies beside the fabric's middle.

    Attributes:
        mu, lam: Plane-stress Lamé parameters times thickness and offset, in N.
        families: Line families, whose `stretching` is times the offset, in N.
    """

    mu: Any
    lam: Any
    families: Sequence[Family] = ()

    def weighted(self, factor: Any) -> Offset:
        """Return all of it times a factor."""
        families = [family.weighted(factor) for family in self.families]
        return Offset(factor * self.mu, factor * self.lam, families)


def _projector(family: Family) -> Vector:
    """Return d dᵀ of a family as (xx, yy, xy)."""
    return (1 + family.cosine) / 2, (1 - family.cosine) / 2, family.sine / 2


def _matrix(tensor: Vector) -> Any:
    """Return a symmetric (xx, yy, xy) as a UFL matrix."""
    return ufl.as_matrix([[tensor[0], tensor[2]], [tensor[2], tensor[1]]])


@dataclass(frozen=True)
class CoupledMoments:
    """Moments Nᵢ = Tᵢ:B:E that the membrane strain exerts at a triangle's edges.

    Attributes:
        values: Nᵢ, three, in J per rad and flat area.
        gradients: Gradients of each at the three corners.
        pairs: Σᵢ φᵢ ∇∇Nᵢ by the edges e₁ and e₂.
    """

    values: Sequence[Any]
    gradients: Sequence[Sequence[Vector]]
    pairs: EdgePairs


def coupling_moment(C: Any, offset: Offset) -> Any:
    """Return the bending moment B:E of the membrane strain, plane-stress Hooke, in N.

    E = U − 1 is the Biot strain of the fabric's mid-surface; U = (C + p I)/s. At the distance z
    along the normal the strain is E + zΛ, as in eq. (5) with z against the normal. Lines along d
    have the strain |F d| − 1 + z d·Λ d.

    Args:
        C: Right Cauchy-Green tensor.
        offset: Stiffness times offset.
    """
    s, p = stretch_invariants(C)
    strain = (C + p * ufl.Identity(2)) / s - ufl.Identity(2)
    moment = offset.lam * (s - 2) * ufl.Identity(2) + 2 * offset.mu * strain
    for family in offset.families:
        along = _matrix(_projector(family))
        moment += family.stretching * (ufl.sqrt(ufl.inner(C, along)) - 1) * along
    return moment


def coupling_stress(C: Any, Lambda: Any, offset: Offset) -> Any:
    """Return the derivative of E:B:Λ by C at a given curvature, (2, 2), in N/m.

    Args:
        C, offset: As in `coupling_moment`.
        Lambda: Curvature, in 1/m.
    """
    mu, lam = offset.mu, offset.lam
    s, p = stretch_invariants(C)
    t, c = ufl.tr(Lambda), ufl.inner(C, Lambda)
    p_C = (ufl.tr(C) * ufl.Identity(2) - C) / (2 * p)
    s_C = (ufl.Identity(2) / 2 + p_C) / s
    by_s = lam * t - 2 * mu * (c + p * t) / (s * s)
    stress = by_s * s_C + 2 * mu / s * (t * p_C + Lambda)
    for family in offset.families:
        along = _matrix(_projector(family))
        stretch = ufl.sqrt(ufl.inner(C, along))
        stress += family.stretching * ufl.inner(Lambda, along) / (2 * stretch) * along
    return stress


def coupled_moments(
    corners: Sequence[Vector],
    jacobian: Any,
    tensors: Sequence[Any],
    angles: Sequence[Any],
    offset: Offset,
) -> CoupledMoments:
    """Return the edges' moments by the membrane strain, and their derivatives.

    All are functions of g = (e₁·e₁, e₁·e₂, e₂·e₂): with the inverse J of the flat chart's Jacobian
    tr C = g:JJᵀ, det C = det g (det J)² and C:T = g:(J T Jᵀ).

    Args:
        corners: Deformed corners.
        jacobian: Jacobian of the flat chart.
        tensors: Tᵢ in Λ = Σᵢ φᵢ Tᵢ, three (xx, yy, xy), in 1/m.
        angles: φᵢ, three in rad.
        offset: As in `coupling_moment`.
    """
    mu, lam = offset.mu, offset.lam
    e = (minus(corners[1], corners[0]), minus(corners[2], corners[0]))
    g = [ufl.variable(value) for value in (dot(e[0], e[0]), dot(e[0], e[1]), dot(e[1], e[1]))]
    J = ufl.inv(jacobian)
    pull = [
        (J[a, 0] * J[b, 0], J[a, 1] * J[b, 1], J[a, 0] * J[b, 1] + J[a, 1] * J[b, 0])
        for a, b in ((0, 0), (0, 1), (1, 1))
    ]
    twice = (1, 2, 1)
    trace = sum(n * g[k] * (pull[k][0] + pull[k][1]) for k, n in enumerate(twice))
    p = ufl.sqrt(g[0] * g[2] - g[1] * g[1]) / abs(ufl.det(jacobian))
    s = ufl.sqrt(trace + 2 * p)

    def product(tensor: Vector) -> Any:
        """Return C:T as a function of g."""
        return sum(n * g[k] * dot(pull[k], tensor) for k, n in enumerate(twice))

    lines = [(family, _projector(family)) for family in offset.families]
    pulls = [(f.stretching * (ufl.sqrt(product(along)) - 1), along) for f, along in lines]

    def moment(tensor: Vector) -> Any:
        """Return T:B:E as a function of g."""
        t = tensor[0] + tensor[1]
        sheet = lam * (s - 2) * t + 2 * mu * ((product(tensor) + p * t) / s - t)
        along = [
            pull * (d[0] * tensor[0] + d[1] * tensor[1] + 2 * d[2] * tensor[2]) for pull, d in pulls
        ]
        return balanced_sum([sheet, *along])

    parts = [components(tensor) for tensor in tensors]
    values = [moment(tensor) for tensor in parts]
    gradients = []
    for value in values:
        by_g = [ufl.diff(value, variable) for variable in g]
        one = plus(times(2 * by_g[0], e[0]), times(by_g[1], e[1]))
        two = plus(times(by_g[1], e[0]), times(2 * by_g[2], e[1]))
        gradients.append((times(-1, plus(one, two)), one, two))

    Lambda = [sum(phi * part[k] for phi, part in zip(angles, parts, strict=True)) for k in range(3)]
    whole = moment((Lambda[0], Lambda[1], Lambda[2]))
    first = [ufl.diff(whole, variable) for variable in g]
    d = {(i, j): ufl.diff(first[i], g[j]) for i in range(3) for j in range(i, 3)}
    # Σ over products of edges e₁e₁ᵀ, e₁e₂ᵀ, e₂e₁ᵀ, e₂e₂ᵀ, and the identity.
    terms = {
        (0, 0): (4 * d[0, 0], 2 * d[0, 1], 2 * d[0, 1], d[1, 1], 2 * first[0]),
        (0, 1): (2 * d[0, 1], 4 * d[0, 2], d[1, 1], 2 * d[1, 2], first[1]),
        (1, 1): (d[1, 1], 2 * d[1, 2], 2 * d[1, 2], 4 * d[2, 2], 2 * first[2]),
    }
    pairs = {
        pair: [
            [
                aa * (e[0][k] * e[0][m])
                + ab * (e[0][k] * e[1][m])
                + ba * (e[1][k] * e[0][m])
                + bb * (e[1][k] * e[1][m])
                + (identity if k == m else 0)
                for m in range(3)
            ]
            for k in range(3)
        ]
        for pair, (aa, ab, ba, bb, identity) in terms.items()
    }
    return CoupledMoments(values, gradients, pairs)
