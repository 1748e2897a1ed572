"""Distance of the simulated shape from the target, eq. (17) without its penalty terms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot, sum_over_ranks
from toros_fem.base.validation import Floats, Ints, checked_floats, real_numbers, shown
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import OtherMesh

# Largest size of a target, and distance from the skin, over the skin's size.
FAR = 10.0


class Objective(Protocol):
    """Function of the positions of the owned nodes to be minimised; both methods are collective."""

    def forward(self, positions: Floats) -> float:
        """Return T, a pure number, at positions (n, 3)."""

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x, (n, 3), in 1/m."""


class Nodes(Protocol):
    """Vertices that an objective sees: those of a `Skin`, or of the whole that it is a part of."""

    @property
    def pattern(self) -> Pattern:
        """Pattern with all vertices."""

    @property
    def comm(self) -> MPI.Comm:
        """Communicator over which they are distributed."""

    @property
    def owned_vertices(self) -> Ints:
        """Vertices on this rank, in the order of its positions."""


def require_objective(name: str, value: Any) -> None:
    """Check that a value has the methods of an objective."""
    if not all(callable(getattr(value, method, None)) for method in ("forward", "backward")):
        raise ParameterError(
            f"{name} = {shown(value)} must be an objective, with methods forward and backward."
        )


class SumObjective:
    """Sum of several objectives, its `parts`."""

    def __init__(self, *parts: Objective) -> None:
        for number, part in enumerate(parts):
            require_objective(f"parts[{number}]", part)
        self.parts = parts

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        return sum(part.forward(positions) for part in self.parts)

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        return np.asarray(sum(part.backward(positions) for part in self.parts))


class ShapeObjective:
    """T = ½ (Σᵥ wᵥ ‖eᵥ‖² + Σᵥ rᵥ ‖eᵥ − ē‖²) / (L² Σᵥ wᵥ), eᵥ = xᵥ − xᵥ*, eq. (17).

    The paper sums over vertices without weights and in its own units. Here each vertex counts by
    its flat area, so that T does not depend on the mesh, and lengths are divided by L, the diagonal
    of the assembled skin's bounding box: without r, T is ½ (root mean square distance over L)².
    Weights may differ by component: a target can be the height of an end plate alone.

    ē is the mean of eᵥ weighted by rᵥ: the second term measures shape and orientation of a part of
    the skin, wherever it is. The first term alone hardly sees the orientation of an end plate,
    since a rotation moves the plate's border by little and the rest of the skin not at all.

    Args:
        skin: The sewn skin.
        target: Target positions of all assembled vertices, shape (n, 3), in m.
        weights: Factor on each vertex's area in w, shape (n,), or (n, 3) for each component,
            ≥ 0; with 0 the vertex is free. Σ w is then the mean over the components.
        relative: Factor on each vertex's area in r, shape (n,), ≥ 0; None: 0.

    Attributes:
        compared: Whether positions along x, y and z count.
    """

    def __init__(
        self,
        skin: Nodes,
        target: Floats,
        weights: Floats | None = None,
        relative: Floats | None = None,
    ) -> None:
        target = checked_target(skin, target)
        by_component = weights is not None and np.ndim(weights) == 2
        position = weighted_areas(skin, "weights", weights, 1.0, 3 if by_component else 1)
        orientation = weighted_areas(skin, "relative", relative, 0.0)
        self.compared = np.broadcast_to(position.any(axis=0), 3)
        unit = position.sum() / position.shape[1] * skin.pattern.size**2
        owned = skin.owned_vertices
        self._comm = skin.comm
        self._target = target[owned]
        self._weight = position[owned] / unit
        self._relative = orientation[owned] / unit if orientation.max() > 0 else None
        self._relative_sum = float(orientation.sum() / unit)

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        gap = positions - self._target
        value = 0.5 * dot(self._comm, gap.ravel(), (self._weight * gap).ravel())
        if self._relative is not None:
            value += 0.5 * dot(self._comm, gap.ravel(), self._relative_gradient(gap).ravel())
        return value

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        gap = positions - self._target
        if self._relative is None:
            return self._weight * gap
        return self._weight * gap + self._relative_gradient(gap)

    def _relative_gradient(self, gap: Floats) -> Floats:
        """Return rᵥ (eᵥ − ē) in units of T (collective)."""
        assert self._relative is not None
        mean = sum_over_ranks(self._comm, (self._relative * gap).sum(axis=0)) / self._relative_sum
        return np.asarray(self._relative * (gap - mean))


# Makes a part of the objective from vertices of a skin and their target positions, (n, 3), in m.
Part: TypeAlias = Callable[[Nodes, Floats], Objective]


@dataclass(frozen=True, eq=False)
class ShapePart:
    """The distance of the whole shape from its target, by `ShapeObjective` with its factors."""

    weights: Floats | None = None
    relative: Floats | None = None

    def __call__(self, nodes: Nodes, target: Floats) -> Objective:
        """Return the objective (collective)."""
        return ShapeObjective(nodes, target, self.weights, self.relative)

    def refined(self, finer: OtherMesh) -> ShapePart:
        """Return the same part on a refined pattern."""
        given = (self.weights, self.relative)
        return ShapePart(*(None if w is None else finer.at_vertices(np.asarray(w)) for w in given))


def require_nodes(skin: Any) -> None:
    """Check that an objective is given a skin."""
    if not all(hasattr(skin, name) for name in ("pattern", "comm", "owned_vertices")):
        raise ParameterError(f"skin = {shown(skin)} must be a Skin, by sew(comm, pattern).")


def checked_target(skin: Nodes, target: Floats) -> Floats:
    """Return the target positions of all assembled vertices, (n, 3), checked."""
    require_nodes(skin)
    n = len(skin.pattern.points)
    what = f"positions ({n}, 3) in m, in the order of pattern.points, or a map"
    return checked_floats("target", target, what, (n, 3))


def require_near(pattern: Pattern, target: Floats) -> None:
    """Check that a target, (n, 3), is not `FAR` times as large as the skin, or as far away.

    One in millimetres would be.
    """
    size, goal = pattern.size, float(np.linalg.norm(np.ptp(target, axis=0)))
    if goal > FAR * size:
        raise ParameterError(
            f"the target is {goal:.3g} m across and the skin {size:.3g} m; no skin stretches "
            f"{FAR:g}-fold. Is the target in millimetres? Multiply it by 1e-3."
        )
    away = float(np.linalg.norm(target.mean(axis=0) - pattern.points.mean(axis=0)))
    if away > FAR * size:
        raise ParameterError(
            f"the target is {away:.3g} m away from the skin, which is {size:.3g} m across. Move it "
            "to the skin, or give it in m."
        )


def weighted_areas(
    skin: Nodes, name: str, given: Floats | None, default: float, columns: int = 1
) -> Floats:
    """Return the flat areas of all vertices times factors, checked, (n, columns).

    Factors are not negative; where they are 1 by default, they are not all zero.
    """
    areas = skin.pattern.vertex_areas[:, None]
    shape = (len(areas), columns)
    if given is None:
        return areas * np.full(shape, default)
    factors = real_numbers(name, given, "one factor for each vertex")
    fits = factors.shape in (shape, shape[:1]) and (factors.ndim == 1) == (columns == 1)
    if not (fits and np.isfinite(factors).all() and factors.min() >= 0) or (
        default > 0 and not factors.max() > 0
    ):
        allowed = f"({shape[0]},)" + (f" or ({shape[0]}, 3)" if name == "weights" else "")
        raise ParameterError(
            f"{name} have shape {factors.shape}; they must be {allowed}, finite, not negative, and "
            "not all zero."
        )
    return areas * factors.reshape(shape)
