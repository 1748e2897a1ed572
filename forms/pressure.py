"""Enclosed volume V, which gives the pressure its potential −P V, eq. (7)."""

from __future__ import annotations

from collections.abc import Sequence

from toros_fem.forms.jets import Jet, Vector, cross, dot


def enclosed_volume(corners: Sequence[Vector]) -> Jet:
    """Return a triangle's part x₀·(x₁ × x₂)/6 of the volume enclosed by the skin, in m³.

    The sum over a closed skin oriented outwards is its volume V; the pressure energy is −P V,
    eq. (7). On an open skin the sum depends on the origin and has no meaning.
    """
    a, b, c = corners
    volume: Jet = dot(a, cross(b, c))
    return volume * (1 / 6)
