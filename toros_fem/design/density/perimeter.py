"""Perimeter by soft erosion, eqs. (15, 16): a penalty for compact designs."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot
from toros_fem.base.validation import (
    Floats,
    require_finite,
    require_flag,
    require_kind,
    require_positive,
)
from toros_fem.design.density.filters import Neighbourhood, Pairs, neighbour_matrices
from toros_fem.meshes.pattern import Mirrored
from toros_fem.meshes.skin import Skin

# Steep enough for an erosion, of the fabric: it removes more islands than the paper's 0.5.
SHARPNESS = -20.0


class Perimeter:
    """Length in m of the print's border, Σᵢ Āᵢ (m(ρ̄ᵢ) − F(ρ̄ᵢ)) / (κ(w) r), eq. (16).

    F(ρ̄ᵢ) = 1 − 1/w ln(mean over the window of e^{w(1−ρ̄ⱼ)}), eq. (15), is a soft minimum of ρ̄
    over a disc of radius r on the panel: ρ̄ − F is the part that an erosion removes. For larger w,
    F approaches the true erosion; for the paper's w = 0.5 it is almost the mean. A larger window
    smooths the border. With κ(w) the value is the length of a straight edge in either case.

    w < 0 erodes the fabric and not the print: F is then a soft maximum, and F − ρ̄ is the part that
    a dilation adds. What is smaller than the window is not counted alike: an erosion makes less of
    an island than its border, and a dilation more; of a hole it is the other way round.

    m(ρ̄ᵢ), the mean over the window, stands for the paper's ρ̄ᵢ. In the plane both have the same
    integral. On a mesh and at the border of a panel they have not: the paper's ρ̄ᵢ rewards print
    on some triangles, and 1/κ(w) enlarges this reward. With the mean no term is negative, and the
    sum is 0 only where ρ̄ is uniform.

    The paper's own sum, Σᵢ (ρ̄ᵢ − F(ρ̄ᵢ)) over triangles without weights, depends on the mesh:
    `area_weighted=False` returns it, a pure number.

    Args:
        window: Radius r of the window in m; about the filter's.
        sharpness: w; not 0.
        area_weighted: Whether triangles count by area; False: equally, as in the paper.
        beyond: What lies beyond the borders, as of `Neighbourhood`.
    """

    def __init__(
        self,
        skin: Skin,
        window: float,
        sharpness: float = SHARPNESS,
        *,
        area_weighted: bool = True,
        beyond: Floats | Mirrored | None = None,
    ) -> None:
        require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
        require_positive(window=window, at_most=skin.pattern.size)
        require_flag(area_weighted=area_weighted)
        require_finite(sharpness=sharpness)
        if sharpness == 0:
            raise ParameterError(
                "sharpness = 0 weighs print and fabric alike, so that no border is seen. Give a "
                "number above 0 to erode the print, or below 0 to erode the fabric."
            )
        self.window, self.sharpness = window, sharpness
        self._comm = skin.comm
        areas = skin.pattern.areas

        def mean_weights(pairs: Pairs) -> list[Floats]:
            weight = areas[pairs.cell] if area_weighted else np.ones(len(pairs.cell))
            return [pairs.fractions(weight)]

        near = Neighbourhood(skin.pattern, window, beyond)
        (self._mean,) = neighbour_matrices(skin, near, mean_weights)
        self._weight: Floats = np.ones(len(skin.owned_cells))
        self._linear: Floats = self._weight  # factor on ρ̄, before F is taken off
        if area_weighted:
            length = edge_factor(sharpness) * window
            self._weight = np.asarray(areas[skin.owned_cells] / length)
            self._linear = self._mean.backward(self._weight)

    def forward(self, projected: Floats) -> float:
        """Return the perimeter in m from ρ̄ at owned triangles (collective)."""
        mean = self._mean.forward(self._exponentials(projected))
        eroded = self._top - np.log(mean) / self.sharpness
        return dot(self._comm, self._linear, projected) - dot(self._comm, self._weight, eroded)

    def backward(self, projected: Floats) -> Floats:
        """Return ∂(perimeter)/∂ρ̄ at owned triangles (collective)."""
        small = self._exponentials(projected)
        mean = self._mean.forward(small)
        back = self._mean.backward(self._weight / mean)
        return np.asarray(self._linear - small * back)

    @property
    def _top(self) -> float:
        """The value of ρ̄ whose exponential is the largest, and is taken as 1."""
        return 0.0 if self.sharpness > 0 else 1.0

    def _exponentials(self, projected: Floats) -> Floats:
        """Return e^{w(1−ρ̄)} over its largest possible value, so that it cannot overflow."""
        return np.asarray(np.exp(-self.sharpness * (projected - self._top)))


def edge_factor(sharpness: float) -> float:
    """Return κ(w) = ∫ (ρ̄ − F) dd / r across a straight edge of the print; κ(−w) = −κ(w)."""

    def removed(d: float) -> float:
        """Return ρ̄ − F at a distance of d radii from the edge, positive inside the print."""
        solid = 0.5 + (np.arcsin(d) + d * np.sqrt(1 - d**2)) / np.pi
        eroded = -np.log(solid * np.exp(-steepness) + 1 - solid) / steepness
        return float((d > 0) - eroded)

    steepness = abs(sharpness)
    size = sum(quad(removed, *half, epsabs=1e-12)[0] for half in ((-1, 0), (0, 1)))
    return float(np.copysign(size, sharpness))
