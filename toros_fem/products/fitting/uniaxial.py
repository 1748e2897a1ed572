"""Uniaxial tension of eq. (1): the lateral stretch solved exactly, the stress, and derivatives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from toros_fem.base.array_types import Floats

# Steps of a bracketed Newton method; each halves the bracket at least where Newton leaves it.
MOST_STEPS = 200
TOLERANCE = 4e-16
# Imaginary step of derivatives: its square is lost beside 1, so that they have no error of theirs.
STEP = 1e-30


class Coefficients(NamedTuple):
    """Coefficients of eq. (1) in uniaxial tension; numbers, or arrays of any shape.

    Attributes:
        mu, lam: Lamé parameters of plane stress, all in one unit of stress.
        a: 1/(c₁ − 1)²; 0 without this bound.
        b: 1/(c₂ − 1)²; 0 without this bound.
        along, across: Stiffness of courses along the pull and across it, in the same unit.
    """

    mu: Any
    lam: Any
    a: Any
    b: Any
    along: Any = 0.0
    across: Any = 0.0


def _balance(x: Any, w: Any, c: Coefficients) -> tuple[Any, Any]:
    """Return the stress across the pull, and its derivative by w."""
    z = x + w
    own, joint = 1 / (1 - c.a * w * w), 1 / (1 - c.b * z * z)
    stress = 2 * c.mu * w * own + c.across * w + c.lam * z * joint
    slope = 2 * c.mu * (1 + c.a * w * w) * own * own + c.across
    return stress, slope + c.lam * (1 + c.b * z * z) * joint * joint


def lateral_strain(x: Floats, c: Coefficients) -> Floats:
    """Return w = λ₂ − 1, (n,), at which the stress across the pull vanishes; x = λ₁ − 1 < c₁ − 1.

    2μ w/(1 − a w²) + k w + λ z/(1 − b z²) = 0 with z = x + w. The left side grows with w, is
    negative at w = −x and positive at w = 0 or next to z = c₂ − 1. So the root is bracketed,
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
    return 2 * c.mu * (x / (1 - c.a * x * x)) + c.along * x + c.lam * (z / (1 - c.b * z * z))


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
