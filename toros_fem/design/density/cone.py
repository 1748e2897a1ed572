"""Cone filter, eq. (11): a convolution on the flat panels."""

from __future__ import annotations

from functools import cache

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.validation import require_kind
from toros_fem.design.density.linear import Filter, Linear
from toros_fem.design.density.neighbours import (
    Neighbourhood,
    Pairs,
    check_radius,
    neighbour_matrices,
)
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin


def cone_filter(skin: Skin, radius: float, beyond: Floats | Mirrored | None = None) -> Filter:
    """Return the filter ρ̃ᵢ = Σⱼ ωᵢⱼ Āⱼ ρⱼ / Σⱼ ωᵢⱼ Āⱼ with ωᵢⱼ = max(R − ‖x̄ᵢ − x̄ⱼ‖, 0), eq. (11).

    Rows sum to 1, so that a uniform density does not change. The weights form a sparse matrix that
    is built once; those of the slope, the exact gradient of (11) at the centroid, are built on
    first use. A matrix takes about 90 (R/h)² bytes per triangle, where h is the edge length: for
    250 000 triangles 0.2 GiB at R = 3 h and 2 GiB at 10 h; the slope takes twice that in addition.
    For larger radii use the Helmholtz filter. `beyond` is that of `Neighbourhood`.

    Warns:
        TorosWarning: The radius is under 1.5 edge lengths and hardly filters.
    """
    require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
    check_radius(skin, radius)
    near, areas = Neighbourhood(skin.pattern, radius, beyond), skin.pattern.areas

    def cone(pairs: Pairs) -> Floats:
        return (radius - pairs.distance) * areas[pairs.cell]

    def weights(pairs: Pairs) -> list[Floats]:
        return [pairs.fractions(cone(pairs))]

    def weight_slopes(pairs: Pairs) -> list[Floats]:
        """Return the gradient of the weights with respect to the point that they belong to."""
        weight, area = cone(pairs), areas[pairs.cell]
        whole = pairs.sums(weight)[pairs.row]
        # At the centroid itself the kernel has a tip; its mean slope there is 0.
        far = np.where(pairs.distance > 0, pairs.distance, np.inf)
        slopes = [area * offset / far for offset in pairs.offset.T]
        return [(one - weight / whole * pairs.sums(one)[pairs.row]) / whole for one in slopes]

    @cache
    def gradient() -> list[Linear]:
        return neighbour_matrices(skin, near, weight_slopes, 2)

    def slope(density: Floats) -> Floats:
        return np.array([one.forward(density) for one in gradient()])

    def slope_backward(by_slope: Floats) -> Floats:
        parts = zip(gradient(), by_slope, strict=True)
        return np.asarray(sum(one.backward(part) for one, part in parts))

    def at_points(density: Floats) -> Floats:
        pattern, every = skin.pattern, skin.gather_cells(density)
        at = pattern.flat_points, pattern.panel_of_point
        # Where no centroid is within the radius, the nearest one gives the value.
        values = every[near.nearest(*at)]
        for pairs in near.pairs(*at):
            weight = cone(pairs)
            total, found = pairs.sums(weight), pairs.sums(weight * every[pairs.cell])
            part = values[pairs.begin : pairs.begin + pairs.rows]
            np.divide(found, total, out=part, where=total > 0)
        return values

    (mean,) = neighbour_matrices(skin, near, weights)
    return Filter(
        mean.forward, mean.backward, "cone", radius, Linear(slope, slope_backward), at_points
    )
