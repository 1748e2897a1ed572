"""Uniaxial tension of eq. (1): the lateral stretch solved exactly, the stress, and derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_floats, require_choice
from toros_fem.materials.sheet import Material

DIRECTIONS = ("course", "wale")  # along the fibres of a `Knit`, and across them
# Steps of a bracketed Newton method; each halves the bracket at least where Newton leaves it.
MOST_STEPS = 200
TOLERANCE = 4e-16


@dataclass(frozen=True)
class Coefficients:
    """Coefficients of eq. (1) in uniaxial tension.

    Attributes:
        mu, lam: Lamé parameters of plane stress, all in one unit of stress.
        a: 1/(c₁ − 1)²; 0 without this bound.
        b: 1/(c₂ − 1)²; 0 without this bound.
        along, across: Stiffness of courses along the pull and across it, in the same unit.
    """

    mu: float
    lam: float
    a: float
    b: float
    along: float = 0.0
    across: float = 0.0


@dataclass(frozen=True, eq=False)
class Curve:
    """Stress and lateral stretch over the stretch, and their derivatives.

    Attributes:
        stress: Nominal stress in the unit of the coefficients, (n,).
        lateral: Lateral stretch λ₂, (n,).
        stress_by, lateral_by: Derivatives by μ, λ, a, b, along, across, (n, 6).
    """

    stress: Floats
    lateral: Floats
    stress_by: Floats
    lateral_by: Floats


def _barrier(e: Floats, a: float) -> Floats:
    return e / (1 - a * e * e)


def _barrier_slope(e: Floats, a: float) -> Floats:
    return (1 + a * e * e) / (1 - a * e * e) ** 2


def _barrier_by_bound(e: Floats, a: float) -> Floats:
    return e**3 / (1 - a * e * e) ** 2


def lateral_strain(strain: Floats, c: Coefficients) -> Floats:
    """Return w = λ₂ − 1 at which the stress across the pull vanishes.

    2μ w/(1 − a w²) + k w + λ z/(1 − b z²) = 0 with z = x + w. The left side grows with w, is
    negative at w = −x and positive at w = 0 or next to z = c₂ − 1. So the root is bracketed,
    however near the bounds, and Newton's method halves the bracket where it would leave it.

    Args:
        strain: x = λ₁ − 1, (n,), from 0 to below c₁ − 1.
        c: Coefficients.
    """
    x = strain
    low = -x
    end = np.inf if c.b == 0 else 1 / np.sqrt(c.b)
    high = np.minimum(0.0, end - x)
    poisson = (c.lam / (2 * c.mu + c.lam)) if c.mu + c.lam > 0 else 0.0
    w = np.where((-poisson * x > low) & (-poisson * x < high), -poisson * x, (low + high) / 2)
    for _ in range(MOST_STEPS):
        z = x + w
        value = 2 * c.mu * _barrier(w, c.a) + c.across * w + c.lam * _barrier(z, c.b)
        slope = 2 * c.mu * _barrier_slope(w, c.a) + c.across + c.lam * _barrier_slope(z, c.b)
        high = np.where(value > 0, w, high)
        low = np.where(value > 0, low, w)
        step = w - value / slope
        new = np.where((step >= low) & (step <= high), step, (low + high) / 2)
        moved, w = np.abs(new - w), new
        if np.all(moved <= TOLERANCE * (1 + x)):
            break
    return w


def tension(strain: Floats, c: Coefficients) -> Curve:
    """Return the curve of uniaxial tension, eq. (1), with its derivatives.

    Args:
        strain: x = λ₁ − 1, (n,), from 0 to below c₁ − 1.
        c: Coefficients.
    """
    x, w = strain, lateral_strain(strain, c)
    z = x + w
    joint, joint_slope = _barrier(z, c.b), _barrier_slope(z, c.b)
    own = _barrier(x, c.a)
    stress = 2 * c.mu * own + c.along * x + c.lam * joint
    none = np.zeros_like(x)
    direct = [
        2 * own, joint, 2 * c.mu * _barrier_by_bound(x, c.a), c.lam * _barrier_by_bound(z, c.b),
        x, none,
    ]  # fmt: skip
    across = [
        2 * _barrier(w, c.a), joint, 2 * c.mu * _barrier_by_bound(w, c.a),
        c.lam * _barrier_by_bound(z, c.b), none, w,
    ]  # fmt: skip
    slope = 2 * c.mu * _barrier_slope(w, c.a) + c.across + c.lam * joint_slope
    lateral_by = -np.stack(across, axis=1) / slope[:, None]
    stress_by = np.stack(direct, axis=1) + (c.lam * joint_slope)[:, None] * lateral_by
    return Curve(stress, 1 + w, stress_by, lateral_by)


def uniaxial_curve(
    material: Material,
    c1: float,
    c2: float,
    stretch: Floats,
    *,
    knit_ratio: float = 1.0,
    direction: str = "wale",
) -> tuple[Floats, Floats]:
    """Return stress and lateral stretch of a strip that is free to narrow, eq. (1).

    Args:
        material: The sheet.
        c1, c2: Bounds of eq. (1).
        stretch: λ₁, (n,), from 1 to below c₁.
        knit_ratio: Modulus along the courses over that along the wales, as of `Knit`.
        direction: Direction of the pull, "course" or "wale".

    Returns:
        Nominal stress per width in N/m, (n,), which is force over undeformed width; and λ₂, (n,).

    Raises:
        ParameterError: A stretch is below 1 or not below c₁, or a value is out of its bounds.
    """
    require_choice("direction", direction, DIRECTIONS)
    values = checked_floats(
        "stretch", stretch, "finite and of shape (n,)", lambda shape: len(shape) == 1
    )
    if c1 <= 1 or c2 <= 1 or knit_ratio < 1:
        raise ParameterError(
            f"c1 = {c1}, c2 = {c2} must be above 1 and knit_ratio = {knit_ratio} at least 1."
        )
    if len(values) and not (values.min() >= 1 and values.max() < c1):
        raise ParameterError(
            f"stretches from {values.min():.6g} to {values.max():.6g} must lie in [1, c1), "
            f"c1 = {c1:.6g}."
        )
    h = material.thickness
    k = material.course_stiffness(knit_ratio)
    course = direction == "course"
    found = tension(
        values - 1,
        Coefficients(
            h * material.mu,
            h * material.lam,
            (c1 - 1) ** -2,
            (c2 - 1) ** -2,
            k if course else 0.0,
            0.0 if course else k,
        ),
    )
    return found.stress, found.lateral
