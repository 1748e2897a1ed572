"""Uniaxial tension, the parameters of a fit, and the coefficients that follow from them.

The lateral stretch is solved exactly, with derivatives. The parameters are ln(E h), ν,
α = (x/(c₁−1))² and β = (z/(c₂−1))², where x and z are the largest strain along the pull and the
largest sum of strains. α and β are small where the data do not reach a bound, so that a bound that
they cannot tell is an interval that ends at the smallest α, not a number without meaning.

Of two directions the threads of a `Knit` take the place of c₁, which is far: ln k and σ = (x/s)² of
courses and wales, x the largest strain along them, k and s as of `Threads`.

A rubber is incompressible, so that its lateral stretch is λ^(−1/2). The parameters of Yeoh's law
are ln(E h), C₂₀ · 6 J/E and C₃₀ · 6 J²/E, J the largest I₁ − 3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from toros_fem.base.errors import FileError
from toros_fem.base.validation import Bools, Floats
from toros_fem.products.fitting.samples import Samples

# Steps of a bracketed Newton method; each halves the bracket at least where Newton leaves it.
MOST_STEPS = 200
TOLERANCE = 4e-16
# Imaginary step of derivatives: its square is lost beside 1, so that they have no error of theirs.
STEP = 1e-30
# Bounds c − 1 lie between these multiples of the largest strain measured.
NEAREST, FARTHEST = 1.005, 10.0
# A sum of strains that was not measured may be bounded well below the strain along the pull.
NEAREST_SUM = 0.2
LARGEST_POISSON = 0.5
# Of threads: largest σ, and c₁ − 1 of the sheet beside them over the largest strain.
STEEPEST, FAR = 36.0, 8.0
# Smallest parameter of C₂₀ of a rubber, less its sign: it softens, and stiffens by C₃₀ again.
SOFTEST = 5.0
# Names of perpendicular directions; a knit is fitted to both.
PAIRS = (("course", "wale"), ("x", "y"), ("along", "across"), ("warp", "weft"))


class Coefficients(NamedTuple):
    """Coefficients of eq. (1) in uniaxial tension; numbers, or arrays of any shape.

    Attributes:
        mu, lam: Lamé parameters of plane stress, all in one unit of stress.
        a: 1/(c₁ − 1)²; 0 without this bound.
        b: 1/(c₂ − 1)²; 0 without this bound.
        along, across: Stiffness of threads along the pull and across it, in the same unit.
        along_more, across_more: 1/s² of these; 0 where they do not stiffen.
    """

    mu: Any
    lam: Any
    a: Any
    b: Any
    along: Any = 0.0
    across: Any = 0.0
    along_more: Any = 0.0
    across_more: Any = 0.0


def _balance(x: Any, w: Any, c: Coefficients) -> tuple[Any, Any]:
    """Return the stress across the pull, and its derivative by w."""
    z = x + w
    own, joint = 1 / (1 - c.a * w * w), 1 / (1 - c.b * z * z)
    more = c.across * np.exp(c.across_more * w * w)
    stress = 2 * c.mu * w * own + more * w + c.lam * z * joint
    slope = 2 * c.mu * (1 + c.a * w * w) * own * own + more * (1 + 2 * c.across_more * w * w)
    return stress, slope + c.lam * (1 + c.b * z * z) * joint * joint


def lateral_strain(x: Floats, c: Coefficients) -> Floats:
    """Return w = λ₂ − 1, (n,), at which the stress across the pull vanishes; x = λ₁ − 1 < c₁ − 1.

    2μ w/(1 − a w²) + k w exp(w²/s²) + λ z/(1 − b z²) = 0 with z = x + w. The left side grows with
    w, is negative at w = −x and positive at w = 0 or next to z = c₂ − 1. So the root is bracketed,
    however near the bounds, and Newton's method halves the bracket where it would leave it.
    """
    low = -x
    high = np.minimum(0.0, (np.inf if c.b == 0 else c.b**-0.5) - x)
    poisson = (c.lam / (2 * c.mu + c.lam)) if c.mu + c.lam > 0 else 0.0
    w = np.where((-poisson * x > low) & (-poisson * x < high), -poisson * x, (low + high) / 2)
    for _ in range(MOST_STEPS):
        value, slope = _balance(x, w, c)
        low, high = np.where(value > 0, low, w), np.where(value > 0, w, high)
        step = w - value / slope
        new = np.where((step >= low) & (step <= high), step, (low + high) / 2)
        moved, w = np.abs(new - w), new
        if np.all(moved <= TOLERANCE * (1 + x)):
            break
    return w


def pulling_stress(x: Any, w: Any, c: Coefficients) -> Any:
    """Return the nominal stress along the pull, in the unit of the coefficients."""
    z = x + w
    threads = c.along * x * np.exp(c.along_more * x * x)
    return 2 * c.mu * (x / (1 - c.a * x * x)) + threads + c.lam * (z / (1 - c.b * z * z))


def tension(
    strain: Floats, coefficients: Callable[[Any], Coefficients], theta: Floats
) -> tuple[Floats, Floats]:
    """Return stress and lateral stretch of uniaxial tension, and their derivatives.

    Derivatives are imaginary parts: each parameter takes an imaginary step, all at once, and one
    more step of Newton's method carries them to the lateral strain.

    Args:
        strain: x = λ₁ − 1, (n,), from 0 to below c₁ − 1.
        coefficients: Coefficients of eq. (1) by the parameters, each of any shape.
        theta: Parameters, (p,).

    Returns:
        Stress and lateral stretch, (2, n), and their derivatives by the parameters, (2, n, p).
    """
    steps = theta[:, None] + 1j * STEP * np.eye(len(theta))
    c = coefficients(steps[:, :, None])
    w = lateral_strain(strain, coefficients(theta))
    value, slope = _balance(strain, w, c)
    moved = w - 1j * (value / slope).imag
    both = np.array([pulling_stress(strain, moved, c), 1 + moved])
    return both[:, 0].real, np.moveaxis(both.imag, 1, 2) / STEP


@dataclass(frozen=True)
class Scales:
    """Strains and stress that the parameters refer to.

    Attributes:
        strain: Largest measured strain along the pull.
        total: Largest measured sum of both strains; None where none was measured.
        stiffness: First guess of E h, in N/m.
        stiff: Direction of the stiffer of two, along which `Knit` has its courses; None for an
            isotropic sheet.
        of_courses, of_wales: Largest measured strain along these.
    """

    strain: float
    total: float | None
    stiffness: float
    stiff: str | None
    of_courses: float = 1.0
    of_wales: float = 1.0

    @property
    def far(self) -> float:
        """Bound c₁ of a sheet whose threads stiffen: beyond what they let it stretch."""
        return 1 + FAR * self.strain

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
        if self.stiff is None:
            low = np.array([guess - 9, 0.0, least, least])
            return low, np.array([guess + 9, LARGEST_POISSON, most, most_sum])
        low = np.array([guess - 9, 0.0, least, *[guess - 9, least] * 2])
        return low, np.array([guess + 9, LARGEST_POISSON, most_sum, *[guess + 9, STEEPEST] * 2])

    @property
    def starts(self) -> list[Floats]:
        """Values to start from: bounds far and near."""
        guess = np.log(self.stiffness)
        if self.stiff is None:
            ends = (0.2, 0.2), (0.8, 0.2), (0.2, 0.8)
            return [np.array([guess, 0.3, one, two]) for one, two in ends]
        # Threads of a direction are stiff and stiffen little, or soft and stiffen much.
        kinds = (0.0, 0.3), (1.0, 3.0), (4.0, 6.0)
        return [
            np.array([guess - 1, 0.4, 0.2, guess - course, more, guess - wale, others])
            for course, more in kinds
            for wale, others in kinds
        ]

    def coefficients(self, theta: Any, course: Bools) -> Coefficients:
        """Return the coefficients of eq. (1), in N/m, of pulls along and across the courses."""
        young, poisson = np.exp(theta[0]), theta[1]
        mu, lam = lame(young, poisson)
        if self.stiff is None:
            return Coefficients(mu, lam, theta[2] / self.strain**2, theta[3] / self.z**2)
        one, other = np.exp(theta[3]), np.exp(theta[5])
        more, others = theta[4] / self.of_courses**2, theta[6] / self.of_wales**2
        return Coefficients(
            mu, lam, 1 / (self.far - 1) ** 2, theta[2] / self.z**2,
            one * course + other * ~course, one * ~course + other * course,
            more * course + others * ~course, more * ~course + others * course,
        )  # fmt: skip

    def values(self, theta: Floats, thickness: float) -> dict[str, Any]:
        """Return all material constants by their names, in SI units, each as an entry of theta."""
        young, poisson = np.exp(theta[0]) / thickness, theta[1]
        mu, lam = lame(young, poisson)
        found = {
            "young": young,
            "poisson": poisson,
            "mu": mu,
            "lam": lam,
        }
        if self.stiff is None:
            bounds = 1 + self.strain / np.sqrt(theta[2]), 1 + self.z / np.sqrt(theta[3])
            return {**found, "c1": bounds[0], "c2": bounds[1]}
        course, wale = np.exp(theta[3]), np.exp(theta[5])
        plane = np.exp(theta[0]) / (1 - poisson**2)
        return {
            **found,
            "c2": 1 + self.z / np.sqrt(theta[2]),
            "course_stiffness": course,
            "course_strain": self.of_courses / np.sqrt(theta[4]),
            "wale_stiffness": wale,
            "wale_strain": self.of_wales / np.sqrt(theta[6]),
            "knit_ratio": (plane + course) / (plane + wale),
        }


@dataclass(frozen=True)
class RubberScales:
    """Strain and stress that the parameters of Yeoh's law refer to.

    Attributes:
        strain: Largest measured strain.
        stiffness: First guess of E h, in N/m.
    """

    strain: float
    stiffness: float
    stiff: None = None
    far: float = np.inf

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """The smallest and the largest value of each parameter; C₃₀ is at least 0."""
        guess = np.log(self.stiffness)
        return np.array([guess - 9, -SOFTEST, 0.0]), np.array([guess + 9, *[STEEPEST] * 2])

    @property
    def starts(self) -> list[Floats]:
        """Values to start from: a rubber that stiffens little, and much."""
        return [np.array([np.log(self.stiffness), *more]) for more in ((0.0, 0.1), (0.5, 1.0))]

    def values(self, theta: Floats, thickness: float) -> dict[str, Any]:
        """Return all material constants by their names, in SI units, each as an entry of theta."""
        young, invariant = np.exp(theta[0]) / thickness, excess(self.strain)
        second, third = (young * theta[k] / (6 * invariant**k) for k in (1, 2))
        return {"young": young, "second": second, "third": third}

    def tension(self, strain: Floats, theta: Floats) -> tuple[Floats, Floats]:
        """Return stress and lateral stretch with their derivatives, as the function `tension`."""
        parts = rubber_stress(strain, self.strain)
        stress = np.exp(theta[0]) * (parts[0] + theta[1] * parts[1] + theta[2] * parts[2])
        slopes = np.zeros((2, len(strain), 3))
        slopes[0] = np.transpose([stress, *(np.exp(theta[0]) * part for part in parts[1:])])
        return np.array([stress, (1 + strain) ** -0.5]), slopes


def excess(strain: Any) -> Any:
    """Return I₁ − 3 of an incompressible strip, λ² + 2/λ − 3."""
    return (1 + strain) ** 2 + 2 / (1 + strain) - 3


def rubber_stress(strain: Floats, largest: float) -> Floats:
    """Return the parts of the nominal stress over E by the parameters of Yeoh's law, (3, n).

    From ψ = E/6 (I₁ − 3) + C₂₀ (I₁ − 3)² + C₃₀ (I₁ − 3)³ it is 2 (λ − λ⁻²) ∂ψ/∂I₁.
    """
    stretch, ratio = 1 + strain, excess(strain) / excess(largest)
    neo_hookean = (stretch - stretch**-2) / 3
    return np.array([neo_hookean, 2 * ratio * neo_hookean, 3 * ratio**2 * neo_hookean])


def rubber_scales_of(samples: Samples) -> RubberScales:
    """Return the scales of a rubber's parameters.

    Raises:
        FileError: No stress is tension.
    """
    neo_hookean = rubber_stress(samples.strain, float(samples.strain.max()))[0]
    stiffness = float(neo_hookean @ samples.stress) / float(neo_hookean @ neo_hookean)
    _require_tension(stiffness)
    return RubberScales(float(samples.strain.max()), stiffness)


def _require_tension(stiffness: float) -> None:
    if not stiffness > 0:
        raise FileError(
            "the stresses fall with the stretch: is the sign of the force that of tension?"
        )


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
    _require_tension(min(secants.values()))
    largest = float(x.max())
    total = max(float(sums.max()), 0.05 * largest) if len(sums) else None
    if len(found) == 1:
        return Scales(largest, total, min(secants.values()), None)
    stiff, soft = sorted(found, key=lambda name: -secants[name])
    ends = (float(x[samples.along(name)].max()) for name in (stiff, soft))
    return Scales(largest, total, min(secants.values()), stiff, *ends)
