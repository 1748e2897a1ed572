"""Distance of the simulated shape from the target, eq. (17) without its penalty terms."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from toros_fem._mpi import dot, sum_over_ranks
from toros_fem._types import Floats
from toros_fem.errors import ParameterError, TargetError
from toros_fem.meshes.skin import Skin


class Objective(Protocol):
    """What is minimised, of the positions of the owned nodes; both methods are collective."""

    def forward(self, positions: Floats) -> float:
        """T, a pure number, at positions (n, 3)."""

    def backward(self, positions: Floats) -> Floats:
        """∂T/∂x, (n, 3), in 1/m."""


class SumObjective:
    """Sum of several objectives."""

    def __init__(self, *parts: Objective) -> None:
        self._parts = parts

    def forward(self, positions: Floats) -> float:
        """T at positions of the owned nodes, (n, 3) (collective)."""
        return sum(part.forward(positions) for part in self._parts)

    def backward(self, positions: Floats) -> Floats:
        """∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        return np.asarray(sum(part.backward(positions) for part in self._parts))


class ShapeObjective:
    """T = ½ (Σᵥ wᵥ ‖eᵥ‖² + Σᵥ rᵥ ‖eᵥ − ē‖²) / (L² Σᵥ wᵥ), eᵥ = xᵥ − xᵥ*, eq. (17).

    The paper sums over vertices unweighted and in its own units. Here each vertex counts by its
    flat area, so that T does not depend on the mesh, and lengths are measured in L, the diagonal
    of the assembled skin's bounding box: without r, T is ½ (root mean square distance over L)².
    Weights may differ by component: a target can be the height of an end plate and no more.

    ē is the mean of eᵥ weighted by rᵥ: r speaks about shape and orientation of a part of the
    skin, wherever it is. By places alone an end plate's orientation hardly counts, since its
    turning moves its own border by little and what is far away by none.

    Args:
        skin: The sewn skin.
        target: Target positions of all assembled vertices, shape (n, 3), in m.
        weights: Factor on each vertex's area in w, shape (n,), or (n, 3) for each component,
            ≥ 0: 0 leaves it free. What Σ w is divided by is then the mean over components.
        relative: Factor on each vertex's area in r, shape (n,), ≥ 0; None: 0.

    Raises:
        TargetError: The target has another number of vertices or is not finite.
        ParameterError: Factors do not fit or are negative, or all weights are zero.
    """

    def __init__(
        self,
        skin: Skin,
        target: Floats,
        weights: Floats | None = None,
        relative: Floats | None = None,
    ) -> None:
        n = len(skin.pattern.points)
        target = checked_target(skin, target)
        areas = skin.pattern.vertex_areas
        components = weights is not None and np.ndim(weights) == 2
        place = areas[:, None] * _factors("weights", weights, (n, 3 if components else 1), 1.0)
        if not place.max() > 0:
            raise ParameterError("weights must not all be zero.")
        turn = areas * _factors("relative", relative, (n, 1), 0.0).ravel()
        unit = place.sum() / place.shape[1] * skin.pattern.size**2
        owned = skin.owned_vertices
        self._comm = skin.comm
        self._target = target[owned]
        self._weight = place[owned] / unit
        self._relative = turn[owned, None] / unit if turn.max() > 0 else None
        self._relative_sum = float(turn.sum() / unit)

    def forward(self, positions: Floats) -> float:
        """T at positions of the owned nodes, (n, 3) (collective)."""
        gap = positions - self._target
        value = 0.5 * dot(self._comm, gap.ravel(), (self._weight * gap).ravel())
        if self._relative is not None:
            value += 0.5 * dot(self._comm, gap.ravel(), self._turned(gap).ravel())
        return value

    def backward(self, positions: Floats) -> Floats:
        """∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        gap = positions - self._target
        if self._relative is None:
            return self._weight * gap
        return self._weight * gap + self._turned(gap)

    def _turned(self, gap: Floats) -> Floats:
        """rᵥ (eᵥ − ē) in units of T (collective)."""
        assert self._relative is not None
        mean = sum_over_ranks(self._comm, (self._relative * gap).sum(axis=0)) / self._relative_sum
        return np.asarray(self._relative * (gap - mean))


def checked_target(skin: Skin, target: Floats) -> Floats:
    """Target positions of all assembled vertices, (n, 3).

    Raises:
        TargetError: The target has another number of vertices or is not finite.
    """
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
    return target


def _factors(name: str, given: Floats | None, shape: tuple[int, int], default: float) -> Floats:
    if given is None:
        return np.full(shape, default)
    factors = np.asarray(given, dtype=np.float64)
    if factors.shape not in (shape, shape[:1]) or (factors.ndim == 1) != (shape[1] == 1):
        wanted = f"({shape[0]},)" + (f" or ({shape[0]}, 3)" if name == "weights" else "")
        raise ParameterError(f"{name} have shape {factors.shape}; they must be {wanted}.")
    if not (np.isfinite(factors).all() and factors.min() >= 0):
        raise ParameterError(f"{name} must be finite and not negative.")
    return factors.reshape(shape)
