"""Membrane energy: a log barrier in the stretches, eq. (1), and a rubber layer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ufl

from toros_fem.forms.kinematics import Strain

# Below this argument `log1p` is a series.
SMALL = 1e-2

# y ↦ ln(1 + y).
Logarithm = Callable[[Any], Any]


def barrier(e: Strain, mu: Any, lam: Any, c1: Any, c2: Any, log: Logarithm) -> Any:
    """Return the energy per flat area, eq. (1) of Montes Maestre et al. 2023, in J/m².

    ψ = −μ a ln(1 − (λ₁−1)²/a) − μ a ln(1 − (λ₂−1)²/a) − (λ/2) b ln(1 − (λ₁+λ₂−2)²/b) with
    a = (c₁−1)², b = (c₂−1)². The two first logarithms are joined, so that equal stretches are no
    special case. For c₁, c₂ → ∞ it is the St. Venant–Kirchhoff energy in the Biot strain,
    μ Σ(λᵢ−1)² + (λ/2)(λ₁+λ₂−2)².

    The logarithms' arguments turn positive again far outside the admissible stretches. So
    admissibility is tested by the stretches (`toros_fem.mechanics.skin.stretch_bounds`).

    Args:
        e: The strain.
        mu, lam: Plane-stress Lamé parameters times thickness, in N/m.
        c1: Bound on a principal stretch: |λᵢ − 1| < c₁ − 1.
        c2: Bound on their sum: |λ₁ + λ₂ − 2| < c₂ − 1.
        log: `log1p` for a value that keeps its digits where strains are small against the bounds,
            or `plain_log`, which is cheap to differentiate: derivatives keep their digits anyway.
    """
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    squares = (e.total**2 + e.square) / 2  # (λ₁−1)² + (λ₂−1)²
    product = (e.total**2 - e.square) / 4  # (λ₁−1)(λ₂−1)
    shear = -mu * a * log((product / a) ** 2 - squares / a)
    return shear - lam / 2 * b * log(-(e.total**2) / b)


def quadratic(e: Strain, mu: Any, lam: Any) -> Any:
    """Return μ Σ(λᵢ−1)² + (λ/2)(λ₁+λ₂−2)² per flat area: eq. (1) without its bounds."""
    return mu * (e.total**2 + e.square) / 2 + lam / 2 * e.total**2


def neo_hooke(e: Strain, mu: Any) -> Any:
    """Return the energy per flat area of a thin incompressible neo-Hookean layer in plane stress.

    ψ = μ/2 (λ₁² + λ₂² + λ₃² − 3) with λ₃ = 1/(λ₁λ₂) (Treloar 1943); μ = E/3 times thickness, in
    N/m.
    """
    return mu / 2 * (e.C[0] + e.C[1] + 1 / (e.p * e.p) - 3)


def log1p(y: Any) -> Any:
    """Return ln(1 + y) to rounding, also for small y, where 1 + y has lost y's digits.

    Below `SMALL` it is the series of 2 artanh z with z = y/(2 + y); four terms leave 1e-20.
    """
    z = y / (2 + y)
    series = 2 * z * (1 + z**2 * (1 / 3 + z**2 * (1 / 5 + z**2 / 7)))
    return ufl.conditional(ufl.lt(abs(y), SMALL), series, ufl.ln(1 + y))


def plain_log(y: Any) -> Any:
    """Return ln(1 + y), without the digits of a small y."""
    return ufl.ln(1 + y)
