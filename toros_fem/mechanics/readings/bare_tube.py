"""The bare closed tube under pressure: strains and pressure of eq. (1) without a mesh."""

from __future__ import annotations

import math

from toros_fem.base.validation import require_between, require_kind, require_positive
from toros_fem.materials.sheet import Composite

# Halvings of an interval that holds a strain.
HALVINGS = 40


def tube_pressure(composite: Composite, radius: float, strain: float) -> float:
    """Return the pressure in Pa that makes a bare tube longer by a strain; infinite if none does.

    Args:
        composite: The sheets; the fabric counts, with its bladder, and as isotropic.
        radius: Of the assembled tube, in m.
        strain: Along the tube, at least 0.

    Raises:
        ParameterError: A number is out of its bounds.
    """
    require_kind("composite", composite, Composite, "a Composite")
    require_positive(radius=radius)
    require_between(0.0, math.inf, strain=strain)
    return bare_tube(composite, radius, strain)[0]


def tube_strains(composite: Composite, radius: float, pressure: float) -> tuple[float, float]:
    """Return the strains around and along of a bare tube at a pressure in Pa."""
    low, high = 0.0, composite.fabric_bounds[0] - 1
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        below = bare_tube(composite, radius, middle)[0] < pressure
        low, high = (middle, high) if below else (low, middle)
    return bare_tube(composite, radius, low)[1], low


def bare_tube(composite: Composite, radius: float, strain: float) -> tuple[float, float]:
    """Return pressure in Pa and strain around of a bare tube that is longer by a strain.

    A long closed tube with stretches λ₁ around and λ₂ along is in equilibrium where
    h ∂ψ/∂λ₁ = p r λ₁ λ₂ and h ∂ψ/∂λ₂ = p r λ₁²/2.
    """
    stiffness, poisson = composite.least_stiffness, composite.fabric.poisson
    mu, lam = stiffness / (2 * (1 + poisson)), stiffness * poisson / (1 - poisson**2)
    a, b = (bound - 1 for bound in composite.fabric_bounds)
    low, high = 0.0, min(a, b - strain)  # of the strain around
    if strain >= a or high <= 0:
        return math.inf, max(high, 0.0)

    def slopes(around: float) -> tuple[float, float]:
        shared = lam * (around + strain) / (1 - ((around + strain) / b) ** 2)
        first, second = (2 * mu * e / (1 - (e / a) ** 2) + shared for e in (around, strain))
        return first, second

    for _ in range(HALVINGS):  # h (2 λ₂ ∂ψ/∂λ₂ − λ₁ ∂ψ/∂λ₁) falls with the strain around
        middle = (low + high) / 2
        around, along = slopes(middle)
        rises = 2 * (1 + strain) * along > (1 + middle) * around
        low, high = (middle, high) if rises else (low, middle)
    return slopes(low)[0] / (radius * (1 + low) * (1 + strain)), low
