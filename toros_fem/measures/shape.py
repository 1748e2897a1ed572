"""Distance of the simulated shape from the target, eq. (17) without its penalty terms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot, largest, sum_over_ranks
from toros_fem.base.validation import Floats, Ints, checked_floats, real_numbers, shown
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.transfer import OtherMesh

# Largest size of a target, and distance from the skin, over the skin's size.
FAR = 10.0
# Length of the differences that give the objective's curvature, over the skin's size.
DIFFERENCE = 1e-4
# Least eigenvalue of H after its diagonal is scaled to 1.
LEAST = 1e-6
# Smallest over largest eigenvalue of B: below this the rotation is not determined.
DETERMINED = 1e-6


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


# ------------------------------------------------------------------------ motion along directions


@dataclass(frozen=True, eq=False)
class Motion:
    """Residuals r, (j,), linear in the positions around a shape, whose squares are a part of T.

    A pressure changes the amplitude of a whole deformation, a bend for instance, and so does every
    density. In MMA's separable approximation each of them alone takes the amplitude to its target,
    and all together go far beyond. As a residual of its own the amplitude is approximated first and
    squared afterwards: the sum of all changes counts.

    With directions Y, the objective's slope g = Yᵀ∂T/∂x and its curvature H = Yᵀ(∂²T/∂x²)Y = L Lᵀ,
    r = L⁻¹ (g + Yᵀ ∂²T/∂x² (x − x₀)) / √2. Along Y the squares of r are then the quadratic part of
    T, up to a constant. Where T is not convex along Y, or where two directions are nearly alike,
    H is replaced by a matrix that is safely positive definite.

    Attributes:
        skin: The skin.
        here: Positions x₀ of the owned nodes, (n, 3), in m.
        offsets: r at x₀, (j,).
        directions: ∂r/∂x at the owned nodes in 1/m, (j, n, 3).
    """

    skin: Skin
    here: Floats
    offsets: Floats
    directions: Floats

    def along(self, positions: Floats) -> Floats:
        """Return r, (j,), at positions of the owned nodes, (n, 3) (collective)."""
        local: Floats = np.einsum("jnk,nk->j", self.directions, positions - self.here)
        return np.asarray(self.offsets + sum_over_ranks(self.skin.comm, local))


def motion_along(
    skin: Skin, objective: Objective, positions: Floats, moves: Sequence[Floats]
) -> Motion:
    """Return the residuals along directions Y at the owned nodes, each (n, 3) (collective).

    Directions may have any unit; one without any motion has a residual of 0.
    """
    comm = skin.comm
    here: Floats = np.array(positions)
    bent: Floats = np.zeros((len(moves), *here.shape))
    for k, move in enumerate(moves):
        longest = largest(comm, float(np.abs(move).max(initial=0.0)))
        if longest > 0:
            step = DIFFERENCE * skin.pattern.size / longest
            ahead, behind = (objective.backward(here + sign * step * move) for sign in (1, -1))
            bent[k] = (ahead - behind) / (2 * step)
    slope = objective.backward(here)
    slopes = np.array([dot(comm, move.ravel(), slope.ravel()) for move in moves])
    curvature = np.array([[dot(comm, a.ravel(), b.ravel()) for b in bent] for a in moves])
    inverse = _inverse_root(curvature.reshape(len(moves), len(moves))) / np.sqrt(2)
    return Motion(skin, here, inverse @ slopes, np.einsum("ij,jnk->ink", inverse, bent))


def _inverse_root(curvature: Floats) -> Floats:
    """Return L⁻¹ with L Lᵀ a positive definite matrix near H; rows of zeros where H has them."""
    size = np.sqrt(np.abs(np.diag(curvature)))
    inverse_size = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    scaled = inverse_size[:, None] * (curvature + curvature.T) / 2 * inverse_size
    value, vector = np.linalg.eigh(scaled)
    value = np.maximum(np.abs(value), LEAST)
    root = np.linalg.cholesky((vector * value) @ vector.T)
    return np.asarray(np.linalg.inv(root) * inverse_size)


# ---------------------------------------------------------------------------------- best rotation


def polar_rotation(moments: Floats) -> tuple[Floats, Floats]:
    """Return the rotation R that maximises tr(Rᵀ M), for each M = Σ w b aᵀ (Kabsch 1976).

    R is the best rotation of a onto b. δR = R [ω]× with ω = B⁻¹ axial(Rᵀ δM), where
    axial(N) = (N₃₂ − N₂₃, N₁₃ − N₃₁, N₂₁ − N₁₂) and B = tr(P) 1 − P, P = Rᵀ M: from
    δM = δR P + R δP with P and δP symmetric. All are (…, 3, 3). B is singular where R is not
    unique: the points lie on a line, or one set is the mirror image of the other.
    """
    u, _, vt = np.linalg.svd(moments)
    sign = np.ones(moments.shape[:-1])
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * sign[..., None, :]) @ vt
    stretch = np.swapaxes(rotation, -1, -2) @ moments
    trace = np.trace(stretch, axis1=-2, axis2=-1)[..., None, None]
    return rotation, trace * np.eye(3) - (stretch + np.swapaxes(stretch, -1, -2)) / 2


def require_determined(matrices: Floats, names: Sequence[str], remedy: str) -> None:
    """Check that the best rotations of named points onto the target are unique.

    B of `polar_rotation`, (k, 3, 3), in m², is the same on all ranks; `remedy` ends the message.
    """
    for name, values in zip(names, np.linalg.eigvalsh(matrices), strict=True):
        if not values[0] > DETERMINED * values[-1]:
            raise ParameterError(
                f"the best rotation of {name} onto the target is not unique: one of them lies on a "
                f"line, or is the other's mirror image (eigenvalues {values} m²). {remedy}"
            )


def axial(matrices: Floats) -> Floats:
    """Return (N₃₂ − N₂₃, N₁₃ − N₃₁, N₂₁ − N₁₂) of matrices, (…, 3, 3)."""
    skew = matrices - np.swapaxes(matrices, -1, -2)
    return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)


def best_rotation(reference: Floats, deformed: Floats) -> Floats:
    """Return the rotation, (3, 3), that best maps centred points, (k, 3), onto others: R a ≈ b."""
    a, b = reference - reference.mean(axis=0), deformed - deformed.mean(axis=0)
    return polar_rotation(b.T @ a)[0]
