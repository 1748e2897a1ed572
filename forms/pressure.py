"""Enclosed volume V, which gives the pressure its potential −P V, eq. (7)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl

from toros_fem.forms.blocks import Blocks, Vector, skew, times
from toros_fem.forms.kinematics import flat_area


def enclosed_volume(corners: Sequence[Any]) -> Any:
    """Return a triangle's part x₀·(x₁ × x₂)/6 of the volume enclosed by the skin, in m³.

    The sum over a closed skin oriented outwards is its volume V; the pressure energy is −P V,
    eq. (7). On an open skin the sum depends on the origin and has no meaning.
    """
    a, b, c = corners
    return ufl.inner(a, ufl.cross(b, c)) / 6


def pressure_blocks(
    blocks: Blocks, corners: Sequence[Vector], jacobian: Any, pressure: Any
) -> None:
    """Add the second variation of −P V, eq. (7), per flat area: the load turns with the skin."""
    factor = pressure / (6 * flat_area(jacobian))
    for u, v, opposite, sign in ((0, 1, 2, 1), (1, 2, 0, 1), (0, 2, 1, -1)):
        blocks.add(u, v, skew(times(sign * factor, corners[opposite])))
