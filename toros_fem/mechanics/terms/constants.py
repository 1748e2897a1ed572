"""Stiffnesses as constants of the forms."""

from __future__ import annotations

from collections.abc import Sequence

from dolfinx import fem

from toros_fem.materials.sheet import Composite
from toros_fem.meshes.skin import Skin


def constants(skin: Skin, *values: float) -> list[fem.Constant]:
    """Return numbers as constants, so that forms are compiled once for all values."""
    return [fem.Constant(skin.mesh, value) for value in values]


def lame_constants(
    skin: Skin, composite: Composite, factors: Sequence[float]
) -> tuple[list[fem.Constant], list[fem.Constant]]:
    """Return μ and λ, each of fabric and print, times a factor for each of the materials."""
    pairs = list(zip(factors, (composite.fabric, composite.reinforcement), strict=True))
    return (
        constants(skin, *(factor * material.mu for factor, material in pairs)),
        constants(skin, *(factor * material.lam for factor, material in pairs)),
    )
