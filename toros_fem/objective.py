"""Distance of the simulated shape from the target, eq. (17) without its penalty terms."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from toros_fem._mpi import dot
from toros_fem.errors import ParameterError, TargetError
from toros_fem.meshes.skin import Skin

Floats = npt.NDArray[np.float64]


class ShapeObjective:
    """T = ½ Σᵥ wᵥ ‖xᵥ − xᵥ*‖² / (L² Σᵥ wᵥ), eq. (17): ½ (root mean square distance over size)².

    The paper sums over vertices unweighted and in its own units. Here each vertex counts by its
    flat area, so that T does not depend on the mesh, and lengths are measured in L, the diagonal
    of the assembled skin's bounding box.

    Args:
        skin: The sewn skin.
        target: Target positions of all assembled vertices, shape (n, 3), in m.
        weights: Further factor on each vertex, shape (n,), ≥ 0: 0 leaves a vertex free.

    Raises:
        TargetError: The target has another number of vertices or is not finite.
        ParameterError: The weights do not fit, are negative, or are all zero.
    """

    def __init__(self, skin: Skin, target: Floats, weights: Floats | None = None) -> None:
        n = len(skin.pattern.points)
        target = np.asarray(target, dtype=np.float64)
        if target.shape != (n, 3):
            raise TargetError(
                f"the target has shape {target.shape}; this skin has {n} vertices, so it must be "
                f"({n}, 3), in the order of pattern.points."
            )
        if not np.isfinite(target).all():
            vertex = int(np.flatnonzero(~np.isfinite(target).all(axis=1))[0])
            raise TargetError(f"target vertex {vertex} = {target[vertex]} is not finite.")
        factor = np.ones(n) if weights is None else np.asarray(weights, dtype=np.float64)
        if factor.shape != (n,):
            raise ParameterError(f"weights have shape {factor.shape}; they must be ({n},).")
        if not (np.isfinite(factor).all() and factor.min() >= 0 and factor.max() > 0):
            raise ParameterError("weights must be finite, not negative, and not all zero.")
        area = factor * skin.pattern.vertex_areas
        area /= area.sum() * skin.pattern.size**2
        self._comm = skin.comm
        self._target = target[skin.owned_vertices].ravel()
        self._weight = np.repeat(area[skin.owned_vertices], 3)

    def forward(self, state: Floats) -> float:
        """T at owned position dofs (collective)."""
        gap = state - self._target
        return 0.5 * dot(self._comm, self._weight, gap**2)

    def backward(self, state: Floats) -> Floats:
        """∂T/∂x at owned position dofs, in 1/m."""
        return self._weight * (state - self._target)
