"""Parameters of a fit, their bounds, and the coefficients of eq. (1) that follow from them.

The parameters are ln(E h), ν, α = (x/(c₁−1))² and β = (z/(c₂−1))², where x and z are the largest
strain along the pull and the largest sum of strains, and for a knit ln(ratio). α and β are small
where the data do not reach a bound, so that a bound that they cannot tell is an interval that ends
at the smallest α, not a number without meaning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.products.fitting.uniaxial import Coefficients

# Bounds c − 1 lie between these multiples of the largest strain measured.
NEAREST, FARTHEST = 1.005, 10.0
# A sum of strains that was not measured may be bounded well below the strain along the pull.
NEAREST_SUM = 0.2
LARGEST_POISSON = 0.5
LARGEST_RATIO = 1000.0
# Columns of the derivatives of `tension`.
MU, LAM, A, B, ALONG, ACROSS = range(6)


@dataclass(frozen=True)
class Scales:
    """Strains and stress that the parameters refer to.

    Attributes:
        strain: Largest measured strain along the pull.
        total: Largest measured sum of both strains; None where none was measured.
        stiffness: First guess of E h, in N/m.
        stiff: Direction of the stiffer of two, in which `Knit` has its fibres; None for an
            isotropic sheet.
    """

    strain: float
    total: float | None
    stiffness: float
    stiff: str | None

    @property
    def knit(self) -> bool:
        """Whether the ratio of a knit is a parameter."""
        return self.stiff is not None

    @property
    def z(self) -> float:
        """Sum of strains that β refers to."""
        return self.strain if self.total is None else self.total

    def bounds(self) -> tuple[Floats, Floats]:
        """Return the smallest and the largest value of each parameter."""
        guess = np.log(self.stiffness)
        least, most = FARTHEST**-2, NEAREST**-2
        most_sum = NEAREST_SUM**-2 if self.total is None else most
        low, high = [guess - 9, 0.0, least, least], [guess + 9, LARGEST_POISSON, most, most_sum]
        if self.knit:
            low, high = low + [0.0], high + [np.log(LARGEST_RATIO)]
        return np.array(low), np.array(high)

    def starts(self) -> list[Floats]:
        """Return values to start from: bounds far and near."""
        rest = [0.3] if self.knit else []
        return [
            np.array([np.log(self.stiffness), 0.3, one, two, *rest])
            for one, two in ((0.2, 0.2), (0.8, 0.2), (0.2, 0.8))
        ]

    def coefficients(self, theta: Floats, direction: str) -> Coefficients:
        """Return the coefficients of eq. (1), in N/m, for a pull along a direction."""
        young, poisson = np.exp(theta[0]), theta[1]
        mu, lam = young / (2 * (1 + poisson)), young * poisson / (1 - poisson**2)
        k = (np.exp(theta[4]) - 1) / (1 - poisson**2) * young if self.knit else 0.0
        course = direction == self.stiff
        a, b = theta[2] / self.strain**2, theta[3] / self.z**2
        return Coefficients(mu, lam, a, b, k if course else 0.0, 0.0 if course else k)

    def chain(self, theta: Floats, direction: str) -> Floats:
        """Return the derivatives of the coefficients by the parameters, (6, p)."""
        young, poisson = np.exp(theta[0]), theta[1]
        rest = 1 - poisson**2
        out = np.zeros((6, len(theta)))
        out[MU, 0] = young / (2 * (1 + poisson))
        out[MU, 1] = -young / (2 * (1 + poisson) ** 2)
        out[LAM, 0] = young * poisson / rest
        out[LAM, 1] = young * (1 + poisson**2) / rest**2
        out[A, 2] = self.strain**-2
        out[B, 3] = self.z**-2
        if self.knit:
            row = ALONG if direction == self.stiff else ACROSS
            factor = np.exp(theta[4]) - 1
            out[row, 0] = factor / rest * young
            out[row, 1] = factor * young * 2 * poisson / rest**2
            out[row, 4] = np.exp(theta[4]) * young / rest
        return out

    def values(self, theta: Floats, thickness: float) -> dict[str, float]:
        """Return all material constants by their names, in SI units."""
        young, poisson = float(np.exp(theta[0])) / thickness, float(theta[1])
        found = {
            "young": young,
            "poisson": poisson,
            "mu": young / (2 * (1 + poisson)),
            "lam": young * poisson / (1 - poisson**2),
            "c1": 1 + self.strain / float(np.sqrt(theta[2])),
            "c2": 1 + self.z / float(np.sqrt(theta[3])),
        }
        if self.knit:
            found["knit_ratio"] = float(np.exp(theta[4]))
        return found

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return the smallest and the largest value of c₁ and c₂."""
        low, high = self.bounds()
        ends = self.values(low, 1.0), self.values(high, 1.0)
        return {
            name: (min(end[name] for end in ends), max(end[name] for end in ends))
            for name in ("c1", "c2")
        }
