"""Parameters of a fit, their bounds, and the coefficients of eq. (1) that follow from them.

The parameters are ln(E h), ν, α = (x/(c₁−1))² and β = (z/(c₂−1))², where x and z are the largest
strain along the pull and the largest sum of strains, and for a knit ln(ratio). α and β are small
where the data do not reach a bound, so that a bound that they cannot tell is an interval that ends
at the smallest α, not a number without meaning.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import FileError
from toros_fem.products.fitting.samples import Samples
from toros_fem.products.fitting.uniaxial import Coefficients

# Bounds c − 1 lie between these multiples of the largest strain measured.
NEAREST, FARTHEST = 1.005, 10.0
# A sum of strains that was not measured may be bounded well below the strain along the pull.
NEAREST_SUM = 0.2
LARGEST_POISSON = 0.5
LARGEST_RATIO = 1000.0
# Names of perpendicular directions; a knit is fitted to both.
PAIRS = (("course", "wale"), ("x", "y"), ("along", "across"), ("warp", "weft"))


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
    def z(self) -> float:
        """Sum of strains that β refers to."""
        return self.strain if self.total is None else self.total

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """The smallest and the largest value of each parameter."""
        guess = np.log(self.stiffness)
        least, most = FARTHEST**-2, NEAREST**-2
        most_sum = NEAREST_SUM**-2 if self.total is None else most
        low = np.array([guess - 9, 0.0, least, least, 0.0])
        high = np.array([guess + 9, LARGEST_POISSON, most, most_sum, np.log(LARGEST_RATIO)])
        number = 4 if self.stiff is None else 5
        return low[:number], high[:number]

    @property
    def starts(self) -> list[Floats]:
        """Values to start from: bounds far and near."""
        rest = [] if self.stiff is None else [0.3]
        return [
            np.array([np.log(self.stiffness), 0.3, one, two, *rest])
            for one, two in ((0.2, 0.2), (0.8, 0.2), (0.2, 0.8))
        ]

    def coefficients(self, theta: Any, course: Bools) -> Coefficients:
        """Return the coefficients of eq. (1), in N/m, of pulls along and across the courses."""
        young, poisson = np.exp(theta[0]), theta[1]
        mu, lam = lame(young, poisson)
        a, b = theta[2] / self.strain**2, theta[3] / self.z**2
        if self.stiff is None:
            return Coefficients(mu, lam, a, b)
        k = (np.exp(theta[4]) - 1) / (1 - poisson**2) * young
        return Coefficients(mu, lam, a, b, k * course, k * ~course)

    def values(self, theta: Floats, thickness: float) -> dict[str, Any]:
        """Return all material constants by their names, in SI units, each as an entry of theta."""
        young, poisson = np.exp(theta[0]) / thickness, theta[1]
        mu, lam = lame(young, poisson)
        found = {
            "young": young,
            "poisson": poisson,
            "mu": mu,
            "lam": lam,
            "c1": 1 + self.strain / np.sqrt(theta[2]),
            "c2": 1 + self.z / np.sqrt(theta[3]),
        }
        return found if self.stiff is None else {**found, "knit_ratio": np.exp(theta[4])}


def lame(young: Any, poisson: Any) -> tuple[Any, Any]:
    """Return Lamé's parameters of plane stress, as of `Material`; of complex numbers too."""
    return young / (2 * (1 + poisson)), young * poisson / (1 - poisson**2)


def scales_of(samples: Samples) -> Scales:
    """Return the scales of the fit's parameters, and which of two directions is the stiffer.

    Raises:
        FileError: The directions are not those of one fabric, or have no strain in common; or no
            stress is tension.
    """
    found = sorted(set(samples.direction))
    if len(found) > 1 and not any(set(found) == set(pair) for pair in PAIRS):
        pairs = "; ".join(" and ".join(pair) for pair in PAIRS)
        raise FileError(
            f"the tests have the directions {', '.join(map(repr, found))}. Two are fitted together "
            f"if they are perpendicular, named {pairs}. Name them so, or fit one by --direction."
        )
    x, sums = samples.strain, samples.strain + samples.lateral - 1
    sums = sums[np.isfinite(sums)]
    common = min(float(x[samples.along(name)].max()) for name in found)
    secants = {}
    for name in found:
        rows = samples.along(name) & (x <= common)
        if not (x[rows] > 0).any():
            first = float(x[samples.along(name)].min())
            raise FileError(
                f"the tests along {name!r} begin at a strain of {first:.3g}, where those of the "
                f"other direction have ended, at {common:.3g}. Measure both over common strains, "
                "or fit one by --direction."
            )
        secants[name] = float(x[rows] @ samples.stress[rows]) / float(x[rows] @ x[rows])
    if not min(secants.values()) > 0:
        raise FileError(
            "the stresses fall with the stretch: is the sign of the force that of tension?"
        )
    largest = float(x.max())
    return Scales(
        largest,
        max(float(sums.max()), 0.05 * largest) if len(sums) else None,
        min(secants.values()),
        max(found, key=lambda name: secants[name]) if len(found) > 1 else None,
    )
