"""Filter of designs that are symmetric by construction."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from toros_fem._types import Floats
from toros_fem.density.filters import Filter
from toros_fem.meshes.skin import Skin


class SymmetricFilter:
    """A filter of the mean over a design's images: whatever the density, ρ̃ is symmetric.

    Args:
        skin: The tile's sewn skin.
        inner: The filter itself; it commutes with the symmetry.
        images: Triangle that each triangle goes to by each operation of the group, (g, t), of
            `Tile.symmetry_maps`.
    """

    def __init__(self, skin: Skin, inner: Filter, symmetry_maps: npt.NDArray[np.int64]) -> None:
        self.name, self.radius = inner.name, inner.radius
        self._skin, self._inner, self._images = skin, inner, symmetry_maps

    def mean(self, density: Floats) -> Floats:
        """Mean over the images of values at owned triangles (collective)."""
        whole = self._skin.gather_cells(density)
        return np.asarray(whole[self._images].mean(axis=0)[self._skin.owned_cells])

    # The group holds each operation's inverse, so that the mean is its own transpose.

    def forward(self, density: Floats) -> Floats:
        """ρ̃ at owned triangles from ρ there (collective)."""
        return self._inner.forward(self.mean(density))

    def backward(self, gradient: Floats) -> Floats:
        """∂T/∂ρ from ∂T/∂ρ̃, owned values (collective)."""
        return self.mean(self._inner.backward(gradient))

    def slope(self, density: Floats) -> Floats:
        """∇ρ̃ at the centroids of owned triangles, (2, k), in 1/m (collective)."""
        return self._inner.slope(self.mean(density))

    def slope_backward(self, gradient: Floats) -> Floats:
        """∂T/∂ρ from ∂T/∂∇ρ̃, (2, k), owned values (collective)."""
        return self.mean(self._inner.slope_backward(gradient))

    def at_points(self, density: Floats) -> Floats:
        """ρ̃ at all flat points of the pattern, (m,), on every rank (collective)."""
        return self._inner.at_points(self.mean(density))
