"""Linear maps of densities with their transposes, and density filters made of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.skin import Skin

Map = Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear map of owned values and its transpose, which takes gradients back (collective)."""

    forward: Map
    backward: Map

    def after(self, first: Linear) -> Linear:
        """Return the map that applies `first`, then this one."""
        return Linear(
            lambda values: self.forward(first.forward(values)),
            lambda gradient: first.backward(self.backward(gradient)),
        )


@dataclass(frozen=True, eq=False)
class Filter(Linear):
    """Map from the design density ρ to the filtered density ρ̃, at owned triangles.

    Attributes:
        name: "cone" or "helmholtz".
        radius: R in m.
        slope: Map from ρ to ∇ρ̃ at the centroids, (2, k), in 1/m.
        at_points: Function that returns ρ̃ at all flat points of the pattern, (m,), on every rank
            from ρ (collective).
    """

    name: str
    radius: float
    slope: Linear
    at_points: Map

    def after(self, first: Linear) -> Filter:
        """Return the filter of what another map makes of a density."""
        value = super().after(first)
        return Filter(
            value.forward,
            value.backward,
            self.name,
            self.radius,
            self.slope.after(first),
            lambda density: self.at_points(first.forward(density)),
        )


def product(matrix: PETSc.Mat) -> Linear:
    """Return the product with a matrix.

    Its vectors are made once: those that are dropped on several ranks stay in memory until all
    ranks clean up together.
    """
    right, left = matrix.createVecs()

    def forward(values: Floats) -> Floats:
        right.array[:] = values
        matrix.mult(right, left)
        return left.array.copy()

    def backward(values: Floats) -> Floats:
        left.array[:] = values
        matrix.multTranspose(left, right)
        return right.array.copy()

    return Linear(forward, backward)


def group_mean(skin: Skin, symmetry_maps: Ints) -> Linear:
    """Return the mean over a symmetry group of a tile: `filter.after` it makes symmetric designs.

    ρ̃ is then symmetric for every density, if the filter commutes with the symmetry. The maps are
    those of `Tile.symmetry_maps`.
    """

    def mean(density: Floats) -> Floats:
        whole = skin.gather_cells(density)
        return np.asarray(whole[symmetry_maps].mean(axis=0)[skin.owned_cells])

    return Linear(mean, mean)  # the group contains each operation's inverse
