"""Potentials of loads: the pressure of a volume, eq. (7), and the skin's own weight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from toros_fem.forms.jets import Jet, Vector, cross, dot


def weight_potential(corners: Sequence[Vector], mass: Any, gravity: Any) -> Jet:
    """Return the potential −m g·x per flat area in J/m², with x the middle of a triangle in m.

    The mass is in kg/m², gravity a vector of three in m/s².
    """
    a, b, c = corners
    middle = [(a[k] + b[k] + c[k]) * (1 / 3) for k in range(3)]
    potential: Jet = dot(middle, [gravity[k] for k in range(3)])
    return potential * (-mass)


def enclosed_volume(corners: Sequence[Vector]) -> Jet:
    """Return a triangle's part x₀·(x₁ × x₂)/6 of the volume enclosed by the skin, in m³.

    The sum over a closed skin oriented outwards is its volume V; the pressure energy is −P V,
    eq. (7). On an open skin the sum depends on the origin and has no meaning.
    """
    a, b, c = corners
    volume: Jet = dot(a, cross(b, c))
    return volume * (1 / 6)
