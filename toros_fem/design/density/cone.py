"""Cone filter, eq. (11): a convolution on the flat panels."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.validation import require_kind
from toros_fem.design.density.neighbours import (
    Neighbourhood,
    Pairs,
    Product,
    check_radius,
    neighbour_matrices,
)
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin


class ConeFilter:
    """Filter ρ̃ᵢ = Σⱼ ωᵢⱼ Āⱼ ρⱼ / Σⱼ ωᵢⱼ Āⱼ with ωᵢⱼ = max(R − ‖x̄ᵢ − x̄ⱼ‖, 0), eq. (11).

    Distances are measured inside one panel, since a print does not cross a seam. Rows sum to 1, so
    that a uniform density does not change. The weights form a sparse matrix that is built once;
    those of the slope, the exact gradient of (11) at the centroid, are built on first use.
    A matrix takes about 90 (R/h)² bytes per triangle, where h is the edge length: for 250 000
    triangles 0.2 GiB at R = 3 h and 2 GiB at 10 h; the slope takes twice that in addition. For
    larger radii use the Helmholtz filter.

    Args:
        skin: The sewn skin.
        radius: R in m.
        lattice: The two lattice vectors, (2, 2), in m, of a periodic tile: distances are measured
            on the torus.
        whole: The symmetric skin that this one is a part of, from `meshes.mirrored`: mirrored
            triangles count too.

    Raises:
        ParameterError: The radius is not positive, larger than the skin, or does not fit the tile.
        PatternError: The skin is moulded.

    Warns:
        ResolutionWarning: The radius is under 1.5 edge lengths and hardly filters.
    """

    name = "cone"

    def __init__(
        self,
        skin: Skin,
        radius: float,
        lattice: Floats | None = None,
        whole: Mirrored | None = None,
    ) -> None:
        require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
        check_radius(skin, radius)
        self._near = Neighbourhood(skin.pattern, radius, lattice, whole)
        self.radius = radius
        self._skin, self._areas = skin, skin.pattern.areas
        (self._mean,) = neighbour_matrices(skin, self._near, self._weights)
        self._slopes: list[Product] = []

    def _weights(self, pairs: Pairs) -> list[Floats]:
        weight = (self.radius - pairs.distance) * self._areas[pairs.cell]
        return [weight / pairs.sums(weight)[pairs.row]]

    def _weight_slopes(self, pairs: Pairs) -> list[Floats]:
        """Return the gradient of the weights with respect to the point that they belong to."""
        area = self._areas[pairs.cell]
        weight = (self.radius - pairs.distance) * area
        whole = pairs.sums(weight)[pairs.row]
        slopes = []
        # At the centroid itself the kernel has a tip; its mean slope there is 0.
        far = np.where(pairs.distance > 0, pairs.distance, np.inf)
        for offset in pairs.offset.T:
            slope = area * offset / far
            slopes.append((slope - weight / whole * pairs.sums(slope)[pairs.row]) / whole)
        return slopes

    def forward(self, density: Floats) -> Floats:
        """Return ρ̃ at owned triangles from ρ there (collective)."""
        return self._mean.forward(density)

    def backward(self, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ from ∂T/∂ρ̃, owned values (collective)."""
        return self._mean.backward(gradient)

    def slope(self, density: Floats) -> Floats:
        """Return ∇ρ̃ at the centroids of owned triangles, (2, k), in 1/m (collective)."""
        if not self._slopes:
            self._slopes = neighbour_matrices(self._skin, self._near, self._weight_slopes, 2)
        return np.array([one.forward(density) for one in self._slopes])

    def slope_backward(self, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ from ∂T/∂∇ρ̃, (2, k), owned values (collective); after `slope`."""
        parts = zip(self._slopes, gradient, strict=True)
        return np.asarray(sum(one.backward(part) for one, part in parts))

    def at_points(self, density: Floats) -> Floats:
        """Return ρ̃ at all flat points of the pattern, (m,), on every rank (collective)."""
        pattern = self._skin.pattern
        every = self._skin.gather_cells(density)
        panel = np.zeros(len(pattern.flat_points), dtype=np.int64)
        panel[pattern.flat_triangles] = pattern.panel[:, None]
        # Where no centroid is within the radius, the nearest one gives the value.
        values = every[self._near.nearest(pattern.flat_points, panel)]
        begin = 0
        for pairs in self._near.pairs(pattern.flat_points, panel):
            weight = (self.radius - pairs.distance) * self._areas[pairs.cell]
            whole = pairs.sums(weight)
            found = whole > 0
            mean = pairs.sums(weight * every[pairs.cell]) / np.where(found, whole, 1.0)
            part = values[begin : begin + pairs.rows]
            part[found] = mean[found]
            begin += pairs.rows
        return values
