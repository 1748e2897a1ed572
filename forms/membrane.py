"""Membrane energy: a log barrier in the principal stretches, eq. (1)."""

from __future__ import annotations

from typing import Any

import ufl
from toros_fem.forms.kinematics import stretch_invariants


def barrier_membrane(C: Any, mu: Any, lam: Any, c1: Any, c2: Any) -> Any:
    """Energy per flat area, eq. (1) of Montes Maestre et al. 2023.

    ψ = −μ a ln(1 − (λ₁−1)²/a) − μ a ln(1 − (λ₂−1)²/a) − (λ/2) b ln(1 − (λ₁+λ₂−2)²/b) with
    a = (c₁−1)², b = (c₂−1)². The two first logarithms are joined, so that only s = λ₁ + λ₂ and
    p = λ₁ λ₂ occur and equal stretches are no special case. For c₁, c₂ → ∞ it is the
    St. Venant–Kirchhoff energy in the Biot strain, μ Σ(λᵢ−1)² + (λ/2)(λ₁+λ₂−2)².

    The logarithms' arguments turn positive again far outside the admissible stretches: whether a
    state is admissible must be told by the stretches (`toros_fem.feasibility`).

    Args:
        C: Right Cauchy–Green tensor, shape (2, 2).
        mu, lam: Plane-stress Lamé parameters times thickness, in N/m.
        c1: Bound on a principal stretch: |λᵢ − 1| < c₁ − 1.
        c2: Bound on their sum: |λ₁ + λ₂ − 2| < c₂ − 1.

    Returns:
        Energy per flat area in J/m².
    """
    s, p = stretch_invariants(C)
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    squares = s * s - 2 * p - 2 * s + 2  # (λ₁−1)² + (λ₂−1)²
    product = p - s + 1  # (λ₁−1)(λ₂−1)
    shear = -mu * a * ufl.ln(1 - squares / a + product**2 / a**2)
    return shear - lam / 2 * b * ufl.ln(1 - (s - 2) ** 2 / b)
