"""Perimeter by soft erosion, eqs. (15, 16): the penalty that makes designs compact."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad

from toros_fem._mpi import dot
from toros_fem._types import Floats
from toros_fem._validate import require_positive
from toros_fem.density.neighbours import (
    Neighbourhood,
    Pairs,
    multiply,
    multiply_transpose,
    neighbour_matrices,
)
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin


class Perimeter:
    """Length in m of the border between printed and plain, Σᵢ Āᵢ (ρ̄ᵢ − F(ρ̄ᵢ)) / (κ(w) r), eq. (16).

    F(ρ̄ᵢ) = 1 − 1/w ln(mean over the window of e^{w(1−ρ̄ⱼ)}), eq. (15), is a soft minimum of ρ̄ over
    a disc of radius r on the panel: ρ̄ − F is what an erosion would take away. A larger w nears
    the true erosion (at 0.5, the paper's, F is almost the mean), a larger window smooths what
    counts as border; κ(w) makes either read as the length of a straight edge.

    The paper's own sum, Σᵢ (ρ̄ᵢ − F(ρ̄ᵢ)) over unweighted triangles, depends on the mesh:
    `plain=True` gives that, a pure number.

    Args:
        skin: The sewn skin.
        window: Radius r of the window in m; about the filter's.
        sharpness: w.
        plain: Whether triangles count alike, as in the paper, instead of by area.
        lattice, whole: As for `ConeFilter`.

    Raises:
        ParameterError: A parameter is not positive.
    """

    def __init__(
        self,
        skin: Skin,
        window: float,
        sharpness: float = 0.5,
        *,
        plain: bool = False,
        lattice: Floats | None = None,
        whole: Mirrored | None = None,
    ) -> None:
        require_positive(sharpness=sharpness)
        self.window, self.sharpness = window, sharpness
        self._comm = skin.comm
        areas = skin.pattern.areas

        def shares(pairs: Pairs) -> list[Floats]:
            weight = np.ones(len(pairs.cell)) if plain else areas[pairs.cell]
            return [weight / pairs.sums(weight)[pairs.row]]

        near = Neighbourhood(skin.pattern, window, lattice, whole)
        (self._matrix,) = neighbour_matrices(skin, near, shares)
        if plain:
            self._weight: Floats = np.ones(len(skin.owned_cells))
        else:
            length = edge_response(sharpness) * window
            self._weight = np.asarray(areas[skin.owned_cells] / length)

    def forward(self, projected: Floats) -> float:
        """Perimeter in m from ρ̄ at owned triangles (collective)."""
        w = self.sharpness
        # Taken relative to its largest possible value, e^w cannot overflow.
        mean = multiply(self._matrix, np.exp(-w * projected))
        eroded = -np.log(mean) / w
        return dot(self._comm, self._weight, projected - eroded)

    def backward(self, projected: Floats) -> Floats:
        """∂(perimeter)/∂ρ̄ at owned triangles (collective)."""
        small = np.exp(-self.sharpness * projected)
        mean = multiply(self._matrix, small)
        back = multiply_transpose(self._matrix, self._weight / mean)
        return np.asarray(self._weight - small * back)


def edge_response(sharpness: float) -> float:
    """κ(w) = ∫ (ρ̄ − F) dd / r across a straight edge between 1 and 0, under a disc of radius r.

    Args:
        sharpness: w of eq. (15).
    """

    def taken(d: float) -> float:
        """ρ̄ − F at a distance of d radii from the edge, positive inside the print."""
        solid = 0.5 + (np.arcsin(d) + d * np.sqrt(1 - d**2)) / np.pi
        eroded = -np.log(solid * np.exp(-sharpness) + 1 - solid) / sharpness
        return float((d > 0) - eroded)

    return float(sum(quad(taken, *half, epsabs=1e-12)[0] for half in ((-1, 0), (0, 1))))
