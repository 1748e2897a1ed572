"""Potential of a skin's own weight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl

from toros_fem.forms.blocks import Vector


def weight_potential(corners: Sequence[Vector], mass: Any, gravity: Any) -> Any:
    """Return the potential −m g·x per flat area in J/m², with x the middle of a triangle.

    Args:
        corners: Deformed corners in m.
        mass: Mass per flat area in kg/m².
        gravity: Acceleration in m/s², a vector of three.
    """
    middle = ufl.as_vector([sum(corner[k] for corner in corners) / 3 for k in range(3)])
    return -mass * ufl.inner(gravity, middle)
