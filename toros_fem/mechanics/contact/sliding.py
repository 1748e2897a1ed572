"""Friction of a skin on ground and bodies: anchors, lagged normal forces, adjoint parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.mechanics.contact.friction import Coulomb
from toros_fem.mechanics.contact.motion import placed, pose_curvature, pose_jacobian, rotation
from toros_fem.mechanics.contact.settings import Contact, ContactSizes


@dataclass(frozen=True, eq=False)
class Sliding:
    """What friction hands from one step of a path to the next.

    Attributes:
        anchors: Point in m at which each vertex sticks to each half-space and each body, in this
            order, (sides, n, 3); on a body where that was made, so that they move with it. Where a
            vertex touches nothing it is its own position.
    """

    anchors: Floats


class SlidingFriction:
    """Friction of all vertices on all half-spaces and bodies, the sides of their contact.

    Friction has a potential where normal forces and tangent planes are held (Li et al. 2020,
    section 5). They are those of `lag`, repeated until they are those of the state itself. On a
    body u is measured from the anchor as the body carries it, so that nothing slides where skin
    and body turn together.

    All arrays are those of all n vertices. Poses are those of all bodies, (bodies, 6).

    Attributes:
        friction, slip: μ of all but pads on the ground, and the slip in m.
        sliding: Anchors at the begin of the step.
        normals: Normal force in N on each vertex from each side, (sides, n, 3), as of `lag`.

    Args:
        contact: The contact; it has friction.
        sizes: Its sizes.
    """

    def __init__(self, contact: Contact, sizes: ContactSizes) -> None:
        assert contact.friction is not None
        self.friction, self.slip = contact.friction, sizes.slip
        self._grounds, self._pads = len(contact.grounds), contact.pads
        self._centres = [body.centre for body in contact.bodies]
        self.sliding = self._settled = Sliding(np.zeros((self.sides, 0, 3)))
        self.normals: Floats = np.zeros((self.sides, 0, 3))

    @property
    def sides(self) -> int:
        """Number of half-spaces and bodies."""
        return self._grounds + len(self._centres)

    def at_rest(self, points: Floats, poses: Floats | None) -> Sliding:
        """Return the anchors of vertices that stick where they are.

        Args:
            points: Positions in m, (n, 3).
            poses: Poses of the bodies.
        """
        return Sliding(
            self._brought_back(np.broadcast_to(points, (self.sides, *points.shape)), poses)
        )

    def begin(self, sliding: Sliding) -> None:
        """Begin a step from the anchors of the last one, without any normal force."""
        self.sliding, self._settled = sliding, sliding
        self.normals = np.zeros_like(sliding.anchors)

    def lag(self, normals: Floats, points: Floats, poses: Floats | None) -> None:
        """Take over the normal forces of a state, and move the anchors along them to its vertices.

        So friction and its counterpart on a body act along one line: they turn nothing together.

        Args:
            normals: On each vertex from each side in N, (sides, n, 3).
            points, poses: The state.
        """
        self.normals = normals
        carried = self.carried(self.sliding, poses)
        unit = normals / np.maximum(np.linalg.norm(normals, axis=2), 1e-300)[:, :, None]
        carried += np.einsum("sni,sni->sn", unit, points - carried)[:, :, None] * unit
        self._settled = Sliding(self._brought_back(carried, poses))

    def energy(self, points: Floats, poses: Floats | None) -> float:
        """Return the potential in J of the lagged normal forces."""
        return float(self._of_law("energy", points, poses).sum())

    def force(self, points: Floats, poses: Floats | None) -> Floats:
        """Return the gradient in N of `energy` by the position on each side, (sides, n, 3)."""
        return self._of_law("force", points, poses)

    def stiffness(self, points: Floats, poses: Floats | None) -> Floats:
        """Return the second derivative in N/m of `energy` on each side, (sides, n, 3, 3)."""
        return self._of_law("stiffness", points, poses)

    def pose_force(self, body: int, force: Floats, poses: Floats) -> Floats:
        """Return the gradient of `energy` by a body's pose, (6,), in N and N m.

        Args:
            body: Number of the body.
            force: As of `force`.
            poses: Poses of the bodies.
        """
        side, anchors = self._grounds + body, self._anchors(body)
        jacobian = pose_jacobian(anchors, self._centres[body], poses[body])
        return np.asarray(-(force[side].ravel() @ jacobian))

    def pose_stiffness(
        self,
        body: int,
        force: Floats,
        stiffness: Floats,
        poses: Floats,
        *,
        definite: bool = False,
    ) -> tuple[Floats, Floats]:
        """Return the second derivatives by positions and a body's pose, and by the pose twice.

        Args:
            body: Number of the body.
            force, stiffness: As of `force` and `stiffness`.
            poses: Poses of the bodies.
            definite: Whether to leave out what may not be positive semidefinite.

        Returns:
            Arrays (n, 3, 6) and (6, 6).
        """
        side, anchors, centre = self._grounds + body, self._anchors(body), self._centres[body]
        jacobian = pose_jacobian(anchors, centre, poses[body]).reshape(-1, 3, 6)
        mixed = np.asarray(-stiffness[side] @ jacobian)
        twice = -np.einsum("nia,nib->ab", jacobian, mixed)
        if not definite:
            twice -= pose_curvature(anchors, centre, poses[body], force[side])
        return mixed, twice

    def end(self, points: Floats, poses: Floats | None) -> Sliding:
        """Return the anchors at the end of the step: each at the elastic slip from its vertex.

        The normal forces must be those of the state itself.
        """
        slip = self._of_law("elastic", points, poses)
        return Sliding(self._brought_back(points - slip, poses))

    def force_change(self, points: Floats, poses: Floats | None, change: Floats) -> Floats:
        """Return the change of `force` in N by one of the normal forces, both (sides, n, 3)."""
        by_normal = self._of_law("force_by_normal", points, poses, self.sliding)
        return np.einsum("snij,snj->sni", by_normal, change)

    def force_backward(
        self, points: Floats, poses: Floats | None, adjoint: Floats
    ) -> tuple[Floats, Floats]:
        """Return the derivatives of Σ adjoint · `force` by normal forces and by anchors.

        Args:
            points, poses: The state.
            adjoint: Numbers for each vertex on each side, (sides, n, 3).

        Returns:
            Both (sides, n, 3).
        """
        by_normal = self._of_law("force_by_normal", points, poses, self.sliding)
        by_motion = self._of_law("stiffness", points, poses)
        return (
            np.einsum("snij,sni->snj", by_normal, adjoint),
            -self._turned_back(np.einsum("snij,sni->snj", by_motion, adjoint), poses),
        )

    def end_backward(
        self, points: Floats, poses: Floats | None, slope: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return the derivatives of Σ slope · `end` by positions, normal forces and anchors.

        Args:
            points, poses: The state.
            slope: Numbers for each anchor, (sides, n, 3).

        Returns:
            Arrays (n, 3), (sides, n, 3) and (sides, n, 3).
        """
        slope = self._turned(slope, poses)
        by_motion = self._of_law("elastic_by_motion", points, poses)
        by_normal = self._of_law("elastic_by_normal", points, poses, self.sliding)
        followed = np.einsum("snij,sni->snj", by_motion, slope)
        return (
            (slope - followed).sum(axis=0),
            -np.einsum("snij,sni->snj", by_normal, slope),
            self._turned_back(followed, poses),
        )

    def _of_law(
        self,
        quantity: str,
        points: Floats,
        poses: Floats | None,
        anchors: Sliding | None = None,
    ) -> Floats:
        """Return a quantity of the law at all vertices on all sides, zero without normal force.

        Where normal forces change, motions count from the anchors of the begin (`sliding`): their
        normal part then matters. Else from those of `lag`, by default.
        """
        active = np.asarray(self.normals.any(axis=2))
        motion = (points - self.carried(anchors or self._settled, poses))[active]
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
        padded = (side < self._grounds) & pads.vertices[vertex]
        friction = np.where(padded, pads.backward, self.friction)
        ratio = np.where(padded, pads.forward / pads.backward, 1.0)
        return Coulomb(friction, self.slip, ratio, pads.direction)

    def _anchors(self, body: int) -> Floats:
        return np.asarray(self._settled.anchors[self._grounds + body])

    def carried(self, sliding: Sliding, poses: Floats | None) -> Floats:
        """Return anchors where the bodies are now, (sides, n, 3) in m.

        Args:
            sliding: The anchors.
            poses: Poses of the bodies.
        """
        out = sliding.anchors.copy()
        for k, centre in enumerate(self._centres):
            assert poses is not None
            out[self._grounds + k] = placed(out[self._grounds + k], centre, poses[k])
        return out

    def carried_change(self, poses: Floats, change: Floats) -> Floats:
        """Return how far anchors move by a small change of the poses, (sides, n, 3) in m.

        Args:
            poses, change: Poses of the bodies and their change.
        """
        out = np.zeros_like(self._settled.anchors)
        for k, centre in enumerate(self._centres):
            jacobian = pose_jacobian(self._anchors(k), centre, poses[k])
            out[self._grounds + k] = (jacobian @ change[k]).reshape(-1, 3)
        return out

    def _brought_back(self, points: Floats, poses: Floats | None) -> Floats:
        """Return where points on bodies, (sides, n, 3), were when these were made."""
        out = np.array(points)
        for k, centre in enumerate(self._centres):
            assert poses is not None
            arms = out[self._grounds + k] - (centre + poses[k, :3])
            out[self._grounds + k] = arms @ rotation(poses[k, 3:]) + centre
        return out

    def _turned(self, vectors: Floats, poses: Floats | None, *, back: bool = False) -> Floats:
        """Return vectors on bodies, (sides, n, 3), turned with them, or back."""
        out = vectors.copy()
        for k in range(len(self._centres)):
            assert poses is not None
            turn = rotation(poses[k, 3:])
            out[self._grounds + k] = out[self._grounds + k] @ (turn if back else turn.T)
        return out

    def _turned_back(self, vectors: Floats, poses: Floats | None) -> Floats:
        return self._turned(vectors, poses, back=True)
