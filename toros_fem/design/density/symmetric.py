"""Filter for designs that are symmetric by construction."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from toros_fem.base.array_types import Floats
from toros_fem.design.density.filters import Filter
from toros_fem.meshes.skin import Skin


class SymmetricFilter:
    """Filter of the mean density over a symmetry group: ρ̃ is symmetric for every density.

    Args:
        skin: The tile's sewn skin.
        inner: A filter that commutes with the symmetry.
        symmetry_maps: Triangle onto which each operation of the group maps each triangle, (g, t),
            as in `Tile.symmetry_maps`.
    """

    def __init__(self, skin: Skin, inner: Filter, symmetry_maps: npt.NDArray[np.int64]) -> None:
        self.name, self.radius = inner.name, inner.radius
        self._skin, self._inner, self._maps = skin, inner, symmetry_maps

    def symmetrized(self, density: Floats) -> Floats:
        """Return the mean over the group of values at owned triangles (collective)."""
        whole = self._skin.gather_cells(density)
        return np.asarray(whole[self._maps].mean(axis=0)[self._skin.owned_cells])

    # The group contains each operation's inverse, so the mean is its own transpose.

    def forward(self, density: Floats) -> Floats:
        """Return ρ̃ at owned triangles from ρ there (collective)."""
        return self._inner.forward(self.symmetrized(density))

    def backward(self, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ from ∂T/∂ρ̃, owned values (collective)."""
        return self.symmetrized(self._inner.backward(gradient))

    def slope(self, density: Floats) -> Floats:
        """Return ∇ρ̃ at the centroids of owned triangles, (2, k), in 1/m (collective)."""
        return self._inner.slope(self.symmetrized(density))

    def slope_backward(self, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ from ∂T/∂∇ρ̃, (2, k), owned values (collective)."""
        return self.symmetrized(self._inner.slope_backward(gradient))

    def at_points(self, density: Floats) -> Floats:
        """Return ρ̃ at all flat points of the pattern, (m,), on every rank (collective)."""
        return self._inner.at_points(self.symmetrized(density))
