"""Edge-based smoothing: two triangles share the strain around their edge (Liu et al. 2009)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from toros_fem.forms.jets import Jet, Vector, minus
from toros_fem.forms.kinematics import Triangle, edge_products, interpolate

# Power of what two stiffnesses have in common: triangles of print and fabric share next to nothing.
SHARPNESS = 2


@dataclass(frozen=True)
class Smoothing:
    """Constants of the triangles across the three edges, as UFL coefficients.

    The third of a triangle at an edge has the mean of C over the two triangles of the edge, by
    their areas (Liu, Nguyen-Thoi & Lam, "An edge-based smoothed finite element method", J. Sound
    Vib. 320, 2009). Two constant strains side by side lock in bending in the plane; their mean
    does not. Where the stiffness jumps, strain does too, and each triangle keeps its own.

    Attributes:
        charts: Three 2×2 matrices B, row by row: across edge i the metric M of the deformed edge
            vector and of the one to the flap is BᵀMB in the triangle's own chart.
        shares: Area of the triangle across each edge over that of both, three; 0 for none.
        around: Projected density there, three.
        stiffnesses: Membrane stiffness of fabric and of reinforcement in N/m.
    """

    charts: Sequence[Any]
    shares: Any
    around: Any
    stiffnesses: Sequence[Any]

    def metric(self, t: Triangle, k: int, one: Vector, two: Vector, flap: Vector) -> list[Jet]:
        """Return the mean (e₁·e₁, e₂·e₂, e₁·e₂) in m² around edge k, in the triangle's own chart.

        The edge is opposite corner k; vectors are those from the first corner to the others, and to
        flap k.
        """
        zero = Jet(0.0), Jet(0.0), Jet(0.0)
        corners = zero, one, two
        start, end = corners[(k + 1) % 3], corners[(k + 2) % 3]
        ee, dd, ed = edge_products((minus(end, start), minus(flap, start)))
        B = self.charts[k]
        a, b, c, d = (B[n] for n in range(4))
        there = [
            ee * (a * a) + dd * (c * c) + ed * (2 * a * c),
            ee * (b * b) + dd * (d * d) + ed * (2 * b * d),
            ee * (a * b) + dd * (c * d) + ed * (a * d + b * c),
        ]
        share = self.share(t.density, k)
        own = edge_products((one, two))
        return [m * (1 - share) + n * share for m, n in zip(own, there, strict=True)]

    def share(self, density: Any, k: int) -> Any:
        """Return the weight of the triangle across edge k."""
        own, other = (interpolate(rho, *self.stiffnesses) for rho in (density, self.around[k]))
        return self.shares[k] * likeness(own, other)


def likeness(one: Any, other: Any) -> Any:
    """Return what two stiffnesses have in common: 1 for equal ones, 0 for one without the other."""
    return (4 * one * other / (one + other) ** 2) ** SHARPNESS
