"""Families of fine parallel lines on a triangle: prints of a relaxed design, threads of a fabric.

A family is known by its share of the flat area and by its direction d = (cos t, sin t) in the
triangle's flat chart. Only d dᵀ enters, so that cos 2t and sin 2t are what the forms take.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import ufl

from toros_fem.forms.jets import Scalar, total

# Below this argument `expm1` is a series.
SMALL = 1e-2
STIFFNESSES = ("stretching", "bending", "twisting")


@dataclass(frozen=True)
class Family:
    """One family of lines, as UFL expressions.

    Attributes:
        cosine, sine: Cosine and sine of twice the angle t.
        stretching: Stiffness along the lines per width of sheet, in N/m.
        bending: Bending stiffness along the lines per width of sheet, in N m.
        twisting: Stiffness against their twist per width of sheet, in N m.
        strain: Strain over which they stiffen; None where they do not.
    """

    cosine: Any
    sine: Any
    stretching: Any
    bending: Any
    twisting: Any
    strain: Any = None

    def weighted(self, factor: Any) -> Family:
        """Return the family with all stiffnesses times a factor."""
        return replace(self, **{name: factor * getattr(self, name) for name in STIFFNESSES})


@dataclass(frozen=True)
class Lines:
    """Shares and directions of the line families of a relaxed design, as UFL coefficients.

    Attributes:
        state: Shares, then cosines, then sines of twice the angles: 3 K piecewise constants.
        crossing: Factor of `fabric_factor`.
    """

    state: Any
    crossing: Any

    @property
    def parts(self) -> tuple[list[Any], list[Any], list[Any]]:
        """Shares, cosines and sines."""
        count = self.state.ufl_shape[0] // 3
        every = [self.state[n] for n in range(3 * count)]
        return every[:count], every[count : 2 * count], every[2 * count :]

    @property
    def cover(self) -> Any:
        """Covered part S of the area."""
        return total(self.parts[0])

    @property
    def fabric_factor(self) -> Any:
        """Factor on the stiffness of the fabric between the lines."""
        return fabric_factor(*self.parts, self.crossing)

    def families(self, stretching: Any, bending: Any, twisting: Any) -> list[Family]:
        """Return the families, each with its share of a stiffness; see `Family`."""
        return [
            Family(cosine, sine, stretching, bending, twisting).weighted(share)
            for share, cosine, sine in zip(*self.parts, strict=True)
        ]


def fabric_factor(
    shares: Sequence[Any], cosines: Sequence[Any], sines: Sequence[Any], crossing: Any
) -> Any:
    """Return the factor by which lines stiffen the fabric between them.

    It is 1/(1 − S) + c S Σ sⱼ sₖ sin⁴(tⱼ − tₖ), summed over the pairs j < k, with S = Σ sₖ < 1: the
    fabric stretches in the gaps alone, and lines that shear against each other bend between their
    bonded crossings, which parallel lines do not have. Of two families the second term is c (s₁² s₂
    + s₂² s₁) sin⁴(t₁ − t₂). It does not change where a family is divided into two with the same
    direction. By 8 sin⁴ t = 3 − 4 cos 2t + cos 4t the double sum costs as much as a single one.
    docs/discovery.md compares it with simulated nets. The arguments may also be arrays; c has the
    ratio of the moduli of print and fabric in it.
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


def stretch_along(family: Family, C: Sequence[Scalar]) -> Any:
    """Return |F d|, by C₁₁, C₂₂ and C₁₂ of the right Cauchy-Green tensor."""
    mean, half = (C[0] + C[1]) / 2, (C[0] - C[1]) / 2
    return ufl.sqrt(mean + half * family.cosine + C[2] * family.sine)


def stretching_energy(families: Sequence[Family], C: Sequence[Scalar]) -> Any:
    """Return ½ Σ kₖ (|F dₖ| − 1)² per flat area in J/m², in tension and compression alike.

    Lines that stiffen over a strain s have ½ k s² (exp(((|F d| − 1)/s)²) − 1), as fibres of
    Holzapfel, Gasser & Ogden 2000, here in the strain of eq. (1).
    """
    return total(_along(f, stretch_along(f, C) - 1) for f in families)


def _along(family: Family, x: Any) -> Any:
    if family.strain is None:
        return family.stretching / 2 * x**2
    return family.stretching / 2 * family.strain**2 * expm1((x / family.strain) ** 2)


def expm1(y: Any) -> Any:
    """Return exp(y) − 1 to rounding, also for small y; five terms of its series leave 1e-15."""
    series = y * (1 + y / 2 * (1 + y / 3 * (1 + y / 4 * (1 + y / 5 * (1 + y / 6)))))
    return ufl.conditional(ufl.lt(abs(y), SMALL), series, ufl.exp(y) - 1)


def shearing_energy(family: Family, stiffness: Any, C: Sequence[Scalar]) -> Any:
    """Return ½ k (d · C n)² per flat area in J/m², n across the direction d of a family."""
    half = (C[0] - C[1]) / 2
    return stiffness / 2 * (C[2] * family.cosine - half * family.sine) ** 2


def bending_of_lines(families: Sequence[Family], Lambda: Sequence[Scalar]) -> Any:
    """Return ½ Σ [B (d·Λ d)² + T (d·Λ n)²] per flat area in J/m², n perpendicular to d.

    Sums over the families are taken of numbers: of the symmetric D in ½ Λ·D·Λ, over Λ = (xx, yy,
    xy). With u = (d₁², d₂², 2 d₁ d₂) and v = (−d₁ d₂, d₁ d₂, d₁² − d₂²) it is Σ B u uᵀ + T v vᵀ.
    """
    terms: dict[tuple[int, int], list[Any]] = {}
    for f in families:
        u = ((1 + f.cosine) / 2, (1 - f.cosine) / 2, f.sine)
        v = (-f.sine / 2, f.sine / 2, f.cosine)
        for i in range(3):
            for j in range(3):
                part = f.bending * u[i] * u[j] + f.twisting * v[i] * v[j]
                terms.setdefault((i, j), []).append(part)
    return total(total(D) * Lambda[i] * Lambda[j] / 2 for (i, j), D in terms.items())
