"""Friction of a skin on ground and bodies: Coulomb's law at vertices, anchors, adjoint parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from toros_fem.base.validation import Bools, Floats, checked_bools, require_positive, unit_vector
from toros_fem.mechanics.contact.bodies import RigidBody, pose_curvature, pose_jacobian, rotation


@dataclass(frozen=True, eq=False)
class Pads:
    """Pads on a skin that slide easily in one direction along the ground.

    Attributes:
        vertices: Whether each assembled vertex carries a pad, (n,).
        direction: Direction in which they slide easily; its length does not matter. What of it is
            normal to the ground is left out.
        forward: Coefficient of friction in this direction.
        backward: Coefficient against this direction and across it, at least `forward`.
    """

    vertices: Bools
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    forward: float = 0.2
    backward: float = 0.8

    def __post_init__(self) -> None:
        require_positive(backward=self.backward)
        require_positive(at_most=self.backward, forward=self.forward)
        shape = (len(self.vertices),)
        vertices = checked_bools("vertices", self.vertices, "assembled vertex", shape).copy()
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        given = unit_vector("direction", self.direction)
        object.__setattr__(self, "direction", tuple(float(v) for v in given))


class SlidingFriction:
    """Friction of all n vertices on all half-spaces and bodies, the sides of their contact.

    Friction has a potential where normal forces and tangent planes are held (Li et al. 2020,
    section 5). They are those of `lag`, repeated until they are those of the state itself. On a
    body u is measured from the anchor as the body carries it, so that nothing slides where skin
    and body turn together.

    A state is the points of all vertices in m, (n, 3), and the poses of all bodies, (bodies, 6).
    Forces, anchors and their derivatives are (sides, n, 3). Anchors are the points at which each
    vertex sticks to each side, on a body where that was made, so that they move with it; where a
    vertex touches nothing its own position. They are what one step of a path hands to the next.

    Attributes:
        grounds: Number of half-spaces, which are the first sides.
        friction, slip: μ of all but pads on the ground, and the slip in m.
        anchors: Anchors at the begin of the step.
        normals: Normal force in N on each vertex from each side, as of `lag`.
    """

    def __init__(
        self,
        friction: float,
        slip: float,
        grounds: int,
        bodies: Sequence[RigidBody],
        pads: Pads | None = None,
    ) -> None:
        self.friction, self.slip, self.grounds, self._pads = friction, slip, grounds, pads
        centres = [np.zeros(3)] * grounds + [body.centre for body in bodies]
        self._centres: Floats = np.reshape(centres, (-1, 1, 3))
        self.begin(np.zeros((self.sides, 0, 3)))

    @property
    def sides(self) -> int:
        """Number of half-spaces and bodies."""
        return len(self._centres)

    def at_rest(self, points: Floats, poses: Floats) -> Floats:
        """Return the anchors of vertices that stick where they are."""
        return self._brought_back(np.repeat(points[None], self.sides, axis=0), poses)

    def begin(self, anchors: Floats) -> None:
        """Begin a step from the anchors of the last one, without any normal force."""
        self.anchors = self._settled = anchors
        self.normals: Floats = np.zeros_like(anchors)

    def lag(self, normals: Floats, points: Floats, poses: Floats) -> None:
        """Take over the normal forces of a state, and move the anchors along them to its vertices.

        So friction and its counterpart on a body act along one line: they turn nothing together.
        """
        self.normals = normals
        carried = self.carried(self.anchors, poses)
        unit = normals / np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[:, :, None]
        carried += np.einsum("sni,sni->sn", unit, points - carried)[:, :, None] * unit
        self._settled = self._brought_back(carried, poses)

    def energy(self, points: Floats, poses: Floats) -> float:
        """Return the potential in J of the lagged normal forces."""
        return float(self._of_law("energy", points, poses).sum())

    def force(self, points: Floats, poses: Floats) -> Floats:
        """Return the gradient in N of `energy` by the position on each side."""
        return self._of_law("force", points, poses)

    def stiffness(self, points: Floats, poses: Floats) -> Floats:
        """Return the second derivative in N/m of `energy` on each side, (sides, n, 3, 3)."""
        return self._of_law("stiffness", points, poses)

    def by_pose(self, body: int, poses: Floats) -> Floats:
        """Return the derivative by a body's pose of the anchors on it, (3 n, 6)."""
        side = self.grounds + body
        return pose_jacobian(self._settled[side], self._centres[side, 0], poses[body])

    def pose_curvature(self, body: int, poses: Floats, force: Floats) -> Floats:
        """Return the second derivative by a body's pose of Σ force · anchors, forces held."""
        side = self.grounds + body
        anchors, centre = self._settled[side], self._centres[side, 0]
        return pose_curvature(anchors, centre, poses[body], force[side])

    def end(self, points: Floats, poses: Floats) -> Floats:
        """Return the anchors at the end of the step: each at the elastic slip from its vertex.

        The normal forces must be those of the state itself.
        """
        slip = self._of_law("elastic", points, poses)
        return self._brought_back(points - slip, poses)

    def force_change(self, points: Floats, poses: Floats, change: Floats) -> Floats:
        """Return the change of `force` in N by one of the normal forces."""
        by_normal = self._of_law("force_by_normal", points, poses, self.anchors)
        return np.einsum("snij,snj->sni", by_normal, change)

    def force_backward(self, points: Floats, poses: Floats, adjoint: Floats) -> Floats:
        """Return the derivative of Σ adjoint · `force` by normal forces."""
        by_normal = self._of_law("force_by_normal", points, poses, self.anchors)
        return np.einsum("snij,sni->snj", by_normal, adjoint)

    def _of_law(
        self, quantity: str, points: Floats, poses: Floats, anchors: Floats | None = None
    ) -> Floats:
        """Return a quantity of the law at all vertices on all sides, zero without normal force.

        Where normal forces change, motions count from the anchors of the begin (`anchors`): their
        normal part then matters. Else from those of `lag`, by default.
        """
        active = np.asarray(self.normals.any(axis=2))
        anchors = self._settled if anchors is None else anchors
        motion = (points - self.carried(anchors, poses))[active]
        values = getattr(self._law(active).at(self.normals[active], motion), quantity)()
        out: Floats = np.zeros((*active.shape, *values.shape[1:]))
        out[active] = values
        return out

    def _law(self, active: Bools) -> Coulomb:
        """Return the law at the active vertices of all sides; pads have theirs on the ground."""
        pads = self._pads
        if pads is None:
            return Coulomb(self.friction, self.slip)
        side, vertex = np.nonzero(active)
        padded = (side < self.grounds) & pads.vertices[vertex]
        friction = np.where(padded, pads.backward, self.friction)
        ratio = np.where(padded, pads.forward / pads.backward, 1.0)
        return Coulomb(friction, self.slip, ratio, pads.direction)

    # Half-spaces stay where they are: their poses are zero.

    def _turns(self, poses: Floats) -> Floats:
        """Return the rotation of each side, (sides, 3, 3)."""
        grounds = [np.eye(3)] * self.grounds
        return np.reshape(grounds + [rotation(pose[3:]) for pose in poses], (-1, 3, 3))

    def _moved_centres(self, poses: Floats) -> Floats:
        """Return the centre of each side where it is now, (sides, 1, 3)."""
        moved = self._centres.copy()
        moved[self.grounds :, 0] += poses[:, :3]
        return moved

    def carried(self, anchors: Floats, poses: Floats) -> Floats:
        """Return anchors where the bodies are now."""
        arms = (anchors - self._centres) @ self._turns(poses).transpose(0, 2, 1)
        return np.asarray(arms + self._moved_centres(poses))

    def _brought_back(self, points: Floats, poses: Floats) -> Floats:
        """Return where points on all sides were when the bodies were made."""
        arms = (points - self._moved_centres(poses)) @ self._turns(poses)
        return np.asarray(arms + self._centres)


@dataclass(frozen=True, eq=False)
class Coulomb:
    """Coulomb's friction of one side of a contact, at n vertices at once (docs/theory/friction.md).

    A vertex has the normal force N, a vector, and the motion u away from its anchor. With P = I − n
    nᵀ and n = N/|N| the friction is

        F = μ |N| φ(g) m,   φ(g) = (2 − g/s)/s for g < s, and 1/g beyond,

    directed against the motion, with m = P u and g = |P u| where the coefficient is the same in all
    directions. F is the gradient by u of μ |N| f(g), for a normal force that is held.

    Where sliding is easier along a direction d in the ground, by a < 1, the gauge of a motion is g
    = √(|P u|² − (1 − a²) v²), v = d·u where that is positive, else 0, and m = P u − (1 − a²) v d. F
    is then still the gradient of a convex function (Goyal, Ruina & Papadopoulos 1991). The
    stiffness jumps where d·u changes its sign; n is the ground's, so that N changes its size alone.

    Attributes:
        friction: Coefficient μ, one or one for each vertex.
        slip: s in m, of the gauge.
        ratio: a, coefficient in the easy direction over μ, at most 1, one or one for each vertex.
        easy: d before its projection to the ground.
    """

    friction: float | Floats
    slip: float
    ratio: float | Floats = 1.0
    easy: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def at(self, normal: Floats, motion: Floats) -> FrictionAt:
        """Return the friction of normal forces N in N and motions u in m, both (n, 3)."""
        return FrictionAt(self, normal, motion)


class FrictionAt:
    """Friction and its derivatives at given normal forces and motions of n vertices."""

    def __init__(self, law: Coulomb, normal: Floats, motion: Floats) -> None:
        self._law, self._size = law, np.linalg.norm(normal, axis=1)
        self._mu, ratio = (np.broadcast_to(v, len(normal)) for v in (law.friction, law.ratio))
        self._unit = normal / np.where(self._size > 0, self._size, 1.0)[:, None]
        self._plane = np.eye(3) - _outer(self._unit, self._unit)
        self._tangential = np.einsum("nij,nj->ni", self._plane, motion)
        self._across = np.einsum("ni,ni->n", self._unit, motion)
        easy = self._plane @ np.array(law.easy)
        easy /= np.maximum(np.linalg.norm(easy, axis=1), 1e-12)[:, None]
        less = (1 - ratio**2) * (np.einsum("ni,ni->n", easy, motion) > 0)
        self._metric = self._plane - _times(less, _outer(easy, easy))
        self._along = np.einsum("nij,nj->ni", self._metric, motion)  # m
        self._gauge = np.sqrt(np.einsum("ni,ni->n", self._along, self._tangential))
        self._turns = ratio == 1  # of pads the ground's normal is fixed

    @cached_property
    def _ratio(self) -> tuple[Floats, Floats]:
        """φ in 1/m and φ'/g in 1/m³; the latter is bounded in products."""
        s, g = self._law.slip, self._gauge
        safe, slides = np.maximum(g, 1e-9 * s), g >= s
        ratio = np.where(slides, 1 / safe, (2 - g / s) / s)
        return ratio, np.where(slides, -1 / safe**3, -1 / (s**2 * safe))

    @cached_property
    def _kept(self) -> tuple[Floats, Floats]:
        """Factor that shortens the gauge to s, and its derivative over g."""
        s = self._law.slip
        longer = np.maximum(self._gauge, s)
        return s / longer, np.where(self._gauge > s, -s / longer**3, 0.0)

    def energy(self) -> Floats:
        """Return μ |N| f(g) in J, (n,), with f(0) = 0."""
        s = self._law.slip
        y = np.minimum(self._gauge / s, 1.0)
        f = s * (y**2 - y**3 / 3) + np.maximum(self._gauge - s, 0.0)
        return np.asarray(self._mu * self._size * f)

    def force(self) -> Floats:
        """Return F in N, (n, 3): the gradient of `energy` by the motion."""
        return np.asarray((self._mu * self._size * self._ratio[0])[:, None] * self._along)

    def stiffness(self) -> Floats:
        """Return ∂F/∂u in N/m, (n, 3, 3), symmetric and positive semidefinite."""
        ratio, change = self._ratio
        parts = _times(ratio, self._metric) + _times(change, _outer(self._along, self._along))
        return _times(self._mu * self._size, parts)

    def force_by_normal(self) -> Floats:
        """Return ∂F/∂N, (n, 3, 3): more or less friction, and another tangent plane."""
        ratio, change = self._ratio
        more = _outer(ratio[:, None] * self._along, self._unit)
        return _times(self._mu, more - self._turned(ratio, change))

    def elastic(self) -> Floats:
        """Return the elastic slip in m, (n, 3): P u, its gauge shortened to s.

        It has the friction of the whole motion. Without a normal force it is zero.
        """
        return np.asarray((self._kept[0] * (self._size > 0))[:, None] * self._tangential)

    def _turned(self, factor: Floats, change: Floats) -> Floats:
        """Return what factor(g) P u loses where N turns, times |N|."""
        across, u = self._across, self._tangential
        parts = _times(across, self._plane) + _outer(self._unit, u)
        parts = _times(factor, parts) + _times(across * change, _outer(u, u))
        return _times(self._turns, parts)


def _times(factor: Floats, parts: Floats) -> Floats:
    return np.asarray(factor[:, None, None] * parts)


def _outer(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, :, None] * b[:, None, :])
