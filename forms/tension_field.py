"""Relaxed energy of a sheet that wrinkles instead of carrying compression."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ufl

from toros_fem.forms.kinematics import Strain
from toros_fem.forms.membrane import Logarithm, barrier, quadratic

# In the place of (λ₁ − λ₂)² = 0, where its root has no derivative; its powers do not underflow.
EQUAL = 1e-100


@dataclass(frozen=True)
class TensionField:
    """State of a sheet in tension-field theory (Pipkin 1986, Steigmann 1990), on one triangle.

    λ₁ ≥ λ₂ are the principal stretches. Where λ₁ ≤ 1 the sheet is slack. Elsewhere w(λ₁) is the
    natural width, at which the stress across λ₁ vanishes; where λ₂ < w the sheet is wrinkled.

    Attributes:
        taut, wrinkled: Conditions; where neither holds the sheet is slack.
        x: λ₁ − 1, but 0 where the sheet is slack.
        y: 1 − w(λ₁).
    """

    taut: Any
    wrinkled: Any
    x: Any
    y: Any


def tension_field(e: Strain, mu: Any, lam: Any, c1: Any, c2: Any) -> TensionField:
    """Return the state of a sheet with the energy of eq. (1); the arguments are of `barrier`."""
    difference = ufl.sqrt(ufl.conditional(ufl.gt(e.square, 0), e.square, EQUAL))
    x = (e.total + difference) / 2
    tension = ufl.gt(x, 0)
    x = ufl.conditional(tension, x, 0.0)
    y = natural_narrowing(x, mu, lam, c1, c2)
    wide = ufl.gt((e.total - difference) / 2, -y)
    return TensionField(ufl.And(tension, wide), ufl.And(tension, ufl.Not(wide)), x, y)


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
    state = tension_field(e, mu, lam, c1, c2)
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    x, y, z = state.x, state.y, state.x - state.y
    one_way = -mu * a * (log(-(x**2) / a) + log(-(y**2) / a))
    one_way -= lam / 2 * b * log(-(z**2) / b)
    loose = ufl.conditional(state.wrinkled, one_way, 0.0)
    psi = ufl.conditional(state.taut, barrier(e, mu, lam, c1, c2, log), loose)
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
