"""Membrane energy: a log barrier in the stretches, eq. (1), also relaxed, and a rubber layer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ufl

from toros_fem.forms.kinematics import Strain

# Below this argument `log1p` is a series.
SMALL = 1e-2

# y ↦ ln(1 + y).
Logarithm = Callable[[Any], Any]

# In the place of (λ₁ − λ₂)² = 0, where its root has no derivative; its powers do not underflow.
EQUAL = 1e-100


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
    return mu / 2 * first_invariant(e)


def yeoh(e: Strain, mu: Any, second: Any, third: Any) -> Any:
    """Return the energy per flat area of the same layer of Yeoh's law (Yeoh 1993).

    ψ = μ/2 (I₁ − 3) + C₂₀ (I₁ − 3)² + C₃₀ (I₁ − 3)³; all constants times thickness, in N/m.
    """
    invariant = first_invariant(e)
    return invariant * (mu / 2 + invariant * (second + invariant * third))


def first_invariant(e: Strain) -> Any:
    """Return I₁ − 3 of an incompressible layer, λ₁² + λ₂² + 1/(λ₁λ₂)² − 3."""
    return e.C[0] + e.C[1] + 1 / (e.p * e.p) - 3


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


def tension_field(e: Strain, mu: Any, lam: Any, c1: Any, c2: Any) -> tuple[Any, Any, Any, Any]:
    """Return the state of a triangle in tension-field theory (Pipkin 1986, Steigmann 1990).

    The energy is eq. (1), the arguments are of `barrier`. λ₁ ≥ λ₂ are the principal stretches.
    Where λ₁ ≤ 1 the sheet is slack. Elsewhere w(λ₁) is the natural width, at which the stress
    across λ₁ vanishes; where λ₂ < w the sheet is wrinkled.

    Returns:
        Whether it is taut, and whether it is wrinkled, as conditions; λ₁ − 1, but 0 where the
        sheet is slack; and 1 − w(λ₁).
    """
    difference = ufl.sqrt(ufl.conditional(ufl.gt(e.square, 0), e.square, EQUAL))
    x = (e.total + difference) / 2
    tension = ufl.gt(x, 0)
    x = ufl.conditional(tension, x, 0.0)
    y = natural_narrowing(x, mu, lam, c1, c2)
    wide = ufl.gt((e.total - difference) / 2, -y)
    return ufl.And(tension, wide), ufl.And(tension, ufl.Not(wide)), x, y


def relaxed(
    e: Strain,
    mu: Any,
    lam: Any,
    c1: Any,
    c2: Any,
    residual: Any,
    log: Logarithm,
) -> Any:
    """Return the relaxed energy per flat area in J/m², of the arguments of `barrier`.

    It is (1 − r) ψ where the sheet is taut, (1 − r) ψ(λ₁, w(λ₁)) where it is wrinkled, and
    everywhere r times `quadratic`: the fraction of the stiffness that remains against compression.
    """
    taut, wrinkled, x, y = tension_field(e, mu, lam, c1, c2)
    a, b, z = (c1 - 1) ** 2, (c2 - 1) ** 2, x - y
    one_way = -mu * a * (log(-(x**2) / a) + log(-(y**2) / a))
    one_way -= lam / 2 * b * log(-(z**2) / b)
    loose = ufl.conditional(wrinkled, one_way, 0.0)
    psi = ufl.conditional(taut, barrier(e, mu, lam, c1, c2, log), loose)
    return (1 - residual) * psi + residual * quadratic(e, mu, lam)


def natural_narrowing(x: Any, mu: Any, lam: Any, c1: Any, c2: Any) -> Any:
    """Return y = 1 − w at which a sheet stretched by λ₁ = 1 + x has no stress across it, x ≥ 0.

    With z = x − y it solves 2μ y (1 − z²/b) = λ z (1 − y²/a), a cubic with three real roots, one
    below 0, one above x. The root between them is that of the sine. All terms go with x, so that y
    keeps its digits where x is small.
    """
    poisson = lam / (2 * mu + lam)
    one, two = (1 - poisson) / (c2 - 1) ** 2, poisson / (c1 - 1) ** 2
    cubic = one + two
    middle = x * (2 * one + two) / (3 * cubic)
    linear = (1 - one * x**2) / cubic
    third = linear / 3 + middle**2
    half = (poisson * x / cubic - 2 * middle**3 - middle * linear) / 2
    sine = -half / (third * ufl.sqrt(third))
    # Rounding, and stretches out of bounds, must not leave the sine's range.
    sine = ufl.conditional(ufl.gt(abs(sine), 1), ufl.sign(sine), sine)
    return middle - 2 * ufl.sqrt(third) * ufl.sin(ufl.asin(sine) / 3)
