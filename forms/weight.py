"""Potential of a skin's own weight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from toros_fem.forms.jets import Jet, Vector, dot


def weight_potential(corners: Sequence[Vector], mass: Any, gravity: Any) -> Jet:
    """Return the potential −m g·x per flat area in J/m², with x the middle of a triangle.

    Args:
        corners: Deformed corners in m.
        mass: Mass per flat area in kg/m².
        gravity: Acceleration in m/s², a vector of three.
    """
    a, b, c = corners
    middle = [(a[k] + b[k] + c[k]) * (1 / 3) for k in range(3)]
    potential: Jet = dot(middle, [gravity[k] for k in range(3)])
    return potential * (-mass)
