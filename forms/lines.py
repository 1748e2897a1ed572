"""Families of fine parallel lines on a triangle: prints of a relaxed design, courses of a knit.

A family is known by its share of the flat area and by its direction d = (cos t, sin t) in the
triangle's flat chart. Only d dᵀ enters, so that cos 2t and sin 2t are what the forms take.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ufl

from toros_fem.forms.blocks import EdgePairs, Vector, balanced_sum, dot, minus


@dataclass(frozen=True)
class Family:
    """One family of lines, as UFL expressions.

    Attributes:
        cosine, sine: Cosine and sine of twice the angle t.
        stretching: Stiffness along the lines per width of sheet, in N/m.
        bending: Bending stiffness along the lines per width of sheet, in N m.
        twisting: Stiffness against their twist per width of sheet, in N m.
    """

    cosine: Any
    sine: Any
    stretching: Any
    bending: Any
    twisting: Any

    def weighted(self, factor: Any) -> Family:
        """Return the family with all stiffnesses times a factor."""
        stiffness = (self.stretching, self.bending, self.twisting)
        return Family(self.cosine, self.sine, *(factor * value for value in stiffness))


@dataclass(frozen=True)
class Lines:
    """Line families of a relaxed design, as UFL coefficients and constants.

    Attributes:
        state: Shares, then cosines, then sines of twice the angles: 3 K piecewise constants.
        stretching: E_p h of the print in N/m.
        bending: E_p h³/12 of the print in N m.
        twisting: G_p h³/3 of the print in N m.
        crossing: Factor of `fabric_factor`.
        offset: Distance in m of the print from the fabric's middle along the normal, which
            `bending` then contains; None for none.
    """

    state: Any
    stretching: Any
    bending: Any
    twisting: Any
    crossing: Any
    offset: Any | None = None

    @property
    def parts(self) -> tuple[list[Any], list[Any], list[Any]]:
        """Shares, cosines and sines."""
        count = self.state.ufl_shape[0] // 3
        every = [self.state[n] for n in range(3 * count)]
        return every[:count], every[count : 2 * count], every[2 * count :]

    @property
    def cover(self) -> Any:
        """Covered part S of the area."""
        return balanced_sum(self.parts[0])

    @property
    def fabric_factor(self) -> Any:
        """Factor on the stiffness of the fabric between the lines."""
        return fabric_factor(*self.parts, self.crossing)

    @property
    def gap_factor(self) -> Any:
        """Its part that is due to the gaps alone: they take all of the stretch."""
        return 1 / (1 - self.cover)

    @property
    def families(self) -> list[Family]:
        """The families, each with its share of the print's stiffness."""
        return [
            Family(cosine, sine, self.stretching, self.bending, self.twisting).weighted(share)
            for share, cosine, sine in zip(*self.parts, strict=True)
        ]

    @property
    def offset_families(self) -> list[Family]:
        """The families, with their stiffness times the offset."""
        return [family.weighted(self.offset) for family in self.families]


def fabric_factor(
    shares: Sequence[Any], cosines: Sequence[Any], sines: Sequence[Any], crossing: Any
) -> Any:
    """Return the factor by which lines stiffen the fabric between them.

    It is 1/(1 − S) + c S Σ sⱼ sₖ sin⁴(tⱼ − tₖ), summed over the pairs j < k, with S = Σ sₖ < 1: the
    fabric stretches in the gaps alone, and lines that shear against each other bend between their
    bonded crossings, which parallel lines do not have. Of two families the second term is
    c (s₁² s₂ + s₂² s₁) sin⁴(t₁ − t₂). It does not change where a family is divided into two with
    the same direction. By 8 sin⁴ t = 3 − 4 cos 2t + cos 4t the double sum costs as much as a single
    one. docs/discovery.md compares it with simulated nets. The arguments may also be arrays.

    Args:
        shares: sₖ.
        cosines, sines: Cosines and sines of twice the angles tₖ.
        crossing: c, with the ratio of the moduli of print and fabric in it.
    """
    cover = sum(shares)

    def squared_sum(cosines: Sequence[Any], sines: Sequence[Any]) -> Any:
        x = sum(share * cosine for share, cosine in zip(shares, cosines, strict=True))
        y = sum(share * sine for share, sine in zip(shares, sines, strict=True))
        return x * x + y * y

    pairs = list(zip(cosines, sines, strict=True))
    twice = squared_sum(cosines, sines)
    fourfold = squared_sum([c * c - s * s for c, s in pairs], [2 * c * s for c, s in pairs])
    return 1 / (1 - cover) + crossing / 16 * cover * (3 * cover * cover - 4 * twice + fourfold)


def stretching_energy(families: Sequence[Family], C: Any) -> Any:
    """Return ½ Σ kₖ (|F dₖ| − 1)² per flat area in J/m², in tension and compression alike.

    Args:
        families: The families.
        C: Right Cauchy-Green tensor.
    """
    mean, half, shear = (C[0, 0] + C[1, 1]) / 2, (C[0, 0] - C[1, 1]) / 2, C[0, 1]
    return balanced_sum(
        [
            f.stretching / 2 * (ufl.sqrt(mean + half * f.cosine + shear * f.sine) - 1) ** 2
            for f in families
        ]
    )


def stretching_stress(families: Sequence[Family], C: Any) -> Any:
    """Return the derivative of `stretching_energy` by C, (2, 2), in N/m.

    It is ½ Σ kₖ (1 − 1/|F dₖ|) dₖ dₖᵀ. Sums are taken of numbers, so that the variation of C stands
    in the forms once and not once for each family.
    """
    mean, half, shear = (C[0, 0] + C[1, 1]) / 2, (C[0, 0] - C[1, 1]) / 2, C[0, 1]
    sums: list[list[Any]] = [[], [], []]
    for f in families:
        pull = f.stretching * (1 - 1 / ufl.sqrt(mean + half * f.cosine + shear * f.sine))
        for terms, factor in zip(sums, (1, f.cosine, f.sine), strict=True):
            terms.append(factor * pull)
    a, b, c = (balanced_sum(terms) / 4 for terms in sums)
    return ufl.as_matrix([[a + b, c], [c, a - b]])


def stretching_pairs(
    families: Sequence[Family], corners: Sequence[Vector], jacobian: Any, geometric: Any
) -> EdgePairs:
    """Return the second variation of `stretching_energy` by a triangle's edges e₁ and e₂.

    With w = J⁻¹ d and m = F d = w₁ e₁ + w₂ e₂ of length g, that of one family is
    k w_a w_b [(1 − 1/g) I + m mᵀ/g³]. Sums over the families are taken of numbers: of k (1 − 1/g)
    w_a w_b, and of k/g³ times products of four w.

    Args:
        families: The families.
        corners: Deformed corners.
        jacobian: Jacobian of the flat chart.
        geometric: 1 for the whole; 0 for its part made positive, 1 − 1/g ≥ 0 in place of 1 − 1/g.
    """
    e = (minus(corners[1], corners[0]), minus(corners[2], corners[0]))
    G = dot(e[0], e[0]), dot(e[0], e[1]), dot(e[1], e[1])
    inverse = ufl.inv(jacobian)
    pairs = ((0, 0), (0, 1), (1, 1))
    # w wᵀ as (11, 12, 22) = constant + cosine · by_cosine + sine · by_sine
    one = [(inverse[a, 0] * inverse[b, 0], inverse[a, 1] * inverse[b, 1]) for a, b in pairs]
    constant = [(x + y) / 2 for x, y in one]
    by_cosine = [(x - y) / 2 for x, y in one]
    by_sine = [
        (inverse[a, 0] * inverse[b, 1] + inverse[a, 1] * inverse[b, 0]) / 2 for a, b in pairs
    ]
    across: list[list[Any]] = [[], [], []]
    along: list[list[Any]] = [[], [], [], [], []]
    for f in families:
        w = [constant[n] + f.cosine * by_cosine[n] + f.sine * by_sine[n] for n in range(3)]
        square = w[0] * G[0] + 2 * (w[1] * G[1]) + w[2] * G[2]
        inverse_length = 1 / ufl.sqrt(square)
        slack = 1 - inverse_length
        kept = (slack + abs(slack)) / 2 + geometric * (slack - abs(slack)) / 2
        beta = f.stretching * kept
        alpha = f.stretching * (1 - kept) * inverse_length * inverse_length
        for n in range(3):
            across[n].append(beta * w[n])
        for n, (p, q) in enumerate(((0, 0), (0, 1), (1, 1), (1, 2), (2, 2))):
            along[n].append(alpha * w[p] * w[q])
    B = [balanced_sum(terms) for terms in across]
    M = [balanced_sum(terms) for terms in along]
    return {
        pair: [
            [
                M[n] * (e[0][k] * e[0][m])
                + M[n + 1] * (e[0][k] * e[1][m] + e[1][k] * e[0][m])
                + M[n + 2] * (e[1][k] * e[1][m])
                + (B[n] if k == m else 0)
                for m in range(3)
            ]
            for k in range(3)
        ]
        for n, pair in enumerate(pairs)
    }


def bending_stiffness(families: Sequence[Family]) -> list[Vector]:
    """Return the symmetric 3×3 stiffness D of lines that bend and twist, over Λ = (xx, yy, xy).

    The energy per flat area is ½ Λ·D·Λ = ½ Σ [B (d·Λ d)² + T (d·Λ n)²], n perpendicular to d, with
    d·Λ d = u·Λ, d·Λ n = v·Λ, u = (d₁², d₂², 2 d₁ d₂), v = (−d₁ d₂, d₁ d₂, d₁² − d₂²).
    """
    terms: dict[tuple[int, int], list[Any]] = {}
    for f in families:
        u = ((1 + f.cosine) / 2, (1 - f.cosine) / 2, f.sine)
        v = (-f.sine / 2, f.sine / 2, f.cosine)
        for i in range(3):
            for j in range(i, 3):
                part = f.bending * u[i] * u[j] + f.twisting * v[i] * v[j]
                terms.setdefault((i, j), []).append(part)
    D = {at: balanced_sum(parts) for at, parts in terms.items()}
    return [
        (D[0, 0], D[0, 1], D[0, 2]),
        (D[0, 1], D[1, 1], D[1, 2]),
        (D[0, 2], D[1, 2], D[2, 2]),
    ]
