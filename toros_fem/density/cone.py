"""Cone filter: convolution on the flat panels, eq. (11)."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from toros_fem._types import Floats
from toros_fem.density.neighbours import (
    Neighbourhood,
    Pairs,
    multiply,
    multiply_transpose,
    neighbour_matrices,
    warn_if_unresolved,
)
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin


class ConeFilter:
    """ρ̃ᵢ = Σⱼ ωᵢⱼ Āⱼ ρⱼ / Σⱼ ωᵢⱼ Āⱼ with ωᵢⱼ = max(R − ‖x̄ᵢ − x̄ⱼ‖, 0), eq. (11).

    Distances are taken inside one panel, since a print does not cross a seam. Rows sum to 1, so
    that a uniform density passes unchanged. The weights are a sparse matrix built once; those of
    the slope, the exact gradient of (11) at the centroid, are built when first asked for.
    A matrix takes about 90 (R/h)² bytes a triangle, h the edge length: for 250 000 triangles
    0.2 GiB at R = 3 h and 2 GiB at 10 h; a slope takes twice that on top. Radii beyond are what
    the Helmholtz filter is for.

    Args:
        skin: The sewn skin.
        radius: R in m.
        lattice: The two vectors, (2, 2), in m, by which a tile repeats: distances are taken on
            the torus.
        whole: What the skin is a part of, `meshes.mirrored`: its images count too.

    Raises:
        ParameterError: The radius is not positive, or does not fit the tile.

    Warns:
        UserWarning: The radius is under 1.5 edge lengths and hardly filters anything.
    """

    name = "cone"

    def __init__(
        self,
        skin: Skin,
        radius: float,
        lattice: Floats | None = None,
        whole: Mirrored | None = None,
    ) -> None:
        self._near = Neighbourhood(skin.pattern, radius, lattice, whole)
        warn_if_unresolved(skin, radius)
        self.radius = radius
        self._skin, self._areas = skin, skin.pattern.areas
        (self._matrix,) = neighbour_matrices(skin, self._near, self._shares)
        self._slopes: list[PETSc.Mat] = []

    def _shares(self, pairs: Pairs) -> list[Floats]:
        weight = (self.radius - pairs.distance) * self._areas[pairs.cell]
        return [weight / pairs.sums(weight)[pairs.row]]

    def _share_slopes(self, pairs: Pairs) -> list[Floats]:
        """Gradient of the shares with respect to the point they belong to."""
        area = self._areas[pairs.cell]
        weight = (self.radius - pairs.distance) * area
        whole = pairs.sums(weight)[pairs.row]
        slopes = []
        # The kernel has a tip where the point is the centroid itself: its mean slope there is 0.
        far = np.where(pairs.distance > 0, pairs.distance, np.inf)
        for offset in pairs.offset.T:
            slope = area * offset / far
            slopes.append((slope - weight / whole * pairs.sums(slope)[pairs.row]) / whole)
        return slopes

    def forward(self, density: Floats) -> Floats:
        """ρ̃ at owned triangles from ρ there (collective)."""
        return multiply(self._matrix, density)

    def backward(self, gradient: Floats) -> Floats:
        """∂T/∂ρ from ∂T/∂ρ̃, owned values (collective)."""
        return multiply_transpose(self._matrix, gradient)

    def slope(self, density: Floats) -> Floats:
        """∇ρ̃ at the centroids of owned triangles, (2, k), in 1/m (collective)."""
        if not self._slopes:
            self._slopes = neighbour_matrices(self._skin, self._near, self._share_slopes, 2)
        return np.array([multiply(matrix, density) for matrix in self._slopes])

    def slope_backward(self, gradient: Floats) -> Floats:
        """∂T/∂ρ from ∂T/∂∇ρ̃, (2, k), owned values (collective); after `slope`."""
        parts = [
            multiply_transpose(m, part) for m, part in zip(self._slopes, gradient, strict=True)
        ]
        return np.asarray(sum(parts))

    def at_points(self, density: Floats) -> Floats:
        """ρ̃ at all flat points of the pattern, (m,), on every rank (collective)."""
        pattern = self._skin.pattern
        every = self._skin.gather_cells(density)
        panel = np.zeros(len(pattern.flat_points), dtype=np.int64)
        panel[pattern.flat_triangles] = pattern.panel[:, None]
        # Where no centroid is within reach, the nearest one speaks.
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
