"""Interface of the density filters, and their choice by name."""

from __future__ import annotations

from typing import Protocol

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import collective
from toros_fem.base.validation import require_choice, require_kind
from toros_fem.design.density.cone import ConeFilter
from toros_fem.design.density.helmholtz import HelmholtzFilter
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin

FILTERS = ("cone", "helmholtz")


class Filter(Protocol):
    """Map from the design density ρ to the filtered density ρ̃, with its derivative.

    Attributes:
        name: "cone" or "helmholtz".
        radius: R in m.
    """

    name: str
    radius: float

    def forward(self, density: Floats) -> Floats:
        """Return ρ̃ at owned triangles from ρ there (collective)."""
        ...

    def backward(self, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ from ∂T/∂ρ̃, owned values (collective)."""
        ...

    def slope(self, density: Floats) -> Floats:
        """Return ∇ρ̃ at the centroids of owned triangles, (2, k), in 1/m (collective)."""
        ...

    def slope_backward(self, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ from ∂T/∂∇ρ̃, (2, k), owned values (collective)."""
        ...

    def at_points(self, density: Floats) -> Floats:
        """Return ρ̃ at all flat points of the pattern, (m,), on every rank (collective)."""
        ...


@collective("skin.comm")
def make_filter(
    name: str,
    skin: Skin,
    radius: float,
    lattice: Floats | None = None,
    whole: Mirrored | None = None,
) -> Filter:
    """Return the filter of a given name.

    Args:
        name: "cone" (`ConeFilter`) or "helmholtz" (`HelmholtzFilter`).
        skin: The sewn skin.
        radius: R in m.
        lattice, whole: As for `ConeFilter`. The Helmholtz filter needs neither: it crosses all
            seams, and its free borders act as planes of symmetry.

    Raises:
        ParameterError: The name is unknown, or the radius is out of bounds.
    """
    require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
    require_choice("filter", name, FILTERS)
    if name == "cone":
        return ConeFilter(skin, radius, lattice, whole)
    return HelmholtzFilter(skin, radius)
