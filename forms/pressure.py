"""Enclosed volume, whose product with the pressure is the load's potential, eq. (7)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl


def enclosed_volume(corners: Sequence[Any]) -> Any:
    """A triangle's share x₀·(x₁ × x₂)/6 of the volume enclosed by the skin, in m³.

    The sum over a closed skin oriented outwards is its volume V; the pressure energy is −P V,
    eq. (7). On an open skin the sum depends on the origin and means nothing.
    """
    a, b, c = corners
    return ufl.inner(a, ufl.cross(b, c)) / 6
