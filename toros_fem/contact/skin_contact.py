"""Contact of a distributed skin: the first rank finds the pairs, all ranks get the results."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from scipy.sparse import block_diag, csc_matrix, identity

from toros_fem._mpi import largest, on_first_rank
from toros_fem._types import Bools, Floats, Ints
from toros_fem.contact.barrier import Barrier
from toros_fem.contact.motion import placed, pose_curvature, pose_jacobian
from toros_fem.contact.neighbours import collision_filter
from toros_fem.contact.settings import Contact, ContactSizes, Ground
from toros_fem.meshes.skin import Skin

T = TypeVar("T")
# Entries of the tangent are kept until they are this many times those that are needed.
STALE = 2.0
# Largest motion of a step over the size of the skin: the space that longer ones sweep is full of
# pairs. Largest rotation of a body in rad: its vertices move straight in the search for pairs.
FARTHEST, LARGEST_TURN = 0.1, 0.2


class SkinContact:
    """Energy, forces and tangent of a skin's contact with itself, bodies and half-spaces.

    Positions are gathered. The first rank computes, so that results do not depend on the number of
    ranks. Middle surfaces stay a thickness apart: the surfaces of bodies and ground are moved
    inwards by half of it. All methods are collective.

    Attributes:
        contact, sizes: As given.
        bodies: Number of bodies with unknowns.
        pairs: Global rows and columns, (2, p), of the entries of `tangent`, on the first rank.
        poses: Poses of all bodies, (k, 6), of those without unknowns as the load has them.

    Args:
        skin: The skin.
        contact: What touches.
        sizes: Its numbers.
        fixed: Fixed components of all vertices, (n, 3).
        numbers: Global unknowns of the owned nodes, (k, 3).
        body_numbers: Global unknowns of the free bodies, (f, 6).
        size: Number of all unknowns.
    """

    def __init__(
        self,
        skin: Skin,
        contact: Contact,
        sizes: ContactSizes,
        fixed: Bools,
        numbers: Ints,
        body_numbers: Ints,
        size: int,
    ) -> None:
        self._skin, self._comm, self._size = skin, skin.comm, size
        self.contact, self.sizes = contact, sizes
        self._free = contact.free_bodies
        self.poses: Floats = np.zeros((len(contact.bodies), 6))
        self._radius = np.array([contact.bodies[k].radius for k in self._free])
        whole = skin.gather_vertices(numbers.astype(np.float64)).astype(np.int64)
        whole[fixed] = -1
        self._number = np.append(whole.ravel(), body_numbers.ravel())
        self._surfaces = [body.inset(sizes.thickness / 2) for body in contact.bodies]
        self.pairs: Ints = np.zeros((2, 0), dtype=np.int64)
        self._keys: Ints = np.zeros(0, dtype=np.int64)
        made = self._only_first(lambda: self._make_barrier(fixed.all(axis=1)))
        if made is not None:
            self._barrier = made

    def _only_first(self, action: Callable[[], T]) -> T | None:
        """Run an action on the first rank; raise its error on all."""
        kept: list[T] = []
        on_first_rank(self._comm, lambda: kept.append(action()))
        return kept[0] if kept else None

    def _make_barrier(self, prescribed: Bools) -> Barrier:
        pattern, contact = self._skin.pattern, self.contact
        points, triangles = [pattern.points], [pattern.triangles]
        areas, count = [pattern.areas], len(pattern.points)
        grounded = [np.arange(count)]
        for k, (body, surface) in enumerate(zip(contact.bodies, self._surfaces, strict=True)):
            corners = body.points[body.triangles]
            sides = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
            points.append(surface)
            triangles.append(body.triangles + count)
            areas.append(np.linalg.norm(np.cross(*sides), axis=1) / 2)
            if k in self._free:
                grounded.append(np.arange(count, count + len(surface)))
            count += len(surface)
        half = self.sizes.thickness / 2
        grounds = [
            Ground(tuple(np.add(g.point, half * np.array(g.normal))), g.normal)
            for g in contact.grounds
        ]
        return Barrier(
            np.concatenate(points),
            np.concatenate(triangles),
            np.concatenate(areas),
            grounds,
            np.concatenate(grounded),
            self.sizes,
            collision_filter(
                pattern,
                self.sizes,
                prescribed=prescribed,
                bodies=[len(surface) for surface in self._surfaces],
                free_bodies=self._free,
                self_contact=contact.self_contact,
            ),
        )

    def poses_at(self, motions: Floats) -> Floats:
        """Return the poses of all bodies, (k, 6), in m and rad.

        Args:
            motions: Unknowns of the free bodies, (f, 6): translation, and rotation vector times
                the body's radius, in m.
        """
        poses = self.poses.copy()
        for k, motion, radius in zip(self._free, motions, self._radius, strict=True):
            poses[k] = np.append(motion[:3], motion[3:] / radius)
        return poses

    def _at(self, nodes: Floats, motions: Floats) -> tuple[Floats, Floats]:
        """Return all vertices of skin and bodies on every rank, and the poses (collective)."""
        skin = self._skin.gather_vertices(nodes)
        poses = self.poses_at(self._comm.bcast(motions, root=0))
        return self._join(skin, poses), poses

    def _join(self, skin: Floats, poses: Floats) -> Floats:
        parts = [skin]
        for body, surface, pose in zip(self.contact.bodies, self._surfaces, poses, strict=True):
            parts.append(placed(surface, body.centre, pose))
        return np.asfortranarray(np.concatenate(parts))

    def _weights(self, fraction: float) -> Floats:
        """Return the weight of each free body, (f, 3), in N."""
        masses = [self.contact.bodies[k].mass for k in self._free]
        return np.outer(np.array(masses, dtype=np.float64), self.contact.gravity) * fraction

    def energy(self, nodes: Floats, motions: Floats, weight_fraction: float) -> float:
        """Return barrier energy less the work of the bodies' weight, in J.

        It is infinite where surfaces are too near to each other.

        Args:
            nodes: Positions of the owned nodes in m, (n, 3).
            motions: Unknowns of the free bodies on the first rank, (f, 6).
            weight_fraction: Fraction of their weight that acts.
        """
        x, poses = self._at(nodes, motions)
        barrier = on_first_rank(self._comm, lambda: self._barrier.energy(x))
        work = (self._weights(weight_fraction) * poses[list(self._free), :3]).sum()
        return barrier - float(work)

    def gap(self, nodes: Floats, motions: Floats) -> float:
        """Return the smallest distance of faces in m, at most that from which on contact acts."""
        x, _ = self._at(nodes, motions)
        return on_first_rank(self._comm, lambda: self._barrier.gap(x))

    @property
    def count(self) -> int:
        """Number of pairs in contact at the last state."""
        return on_first_rank(self._comm, lambda: self._barrier.count)

    def gradient(
        self, nodes: Floats, motions: Floats, weight_fraction: float
    ) -> tuple[Floats, Floats]:
        """Return the first variation in N: at the owned nodes, (n, 3), and at the bodies, (f, 6).

        Args:
            nodes, motions, weight_fraction: As of `energy`.
        """
        whole = self.forces(nodes, motions)
        count = len(self._skin.pattern.points)
        bodies: Floats = np.zeros((len(self._free), 6))
        if len(bodies):
            _, poses = self._at(nodes, motions)
            for row, (k, part) in enumerate(self._split(whole)):
                bodies[row] = part.ravel() @ self._jacobian(k, poses[k])
            bodies[:, :3] -= self._weights(weight_fraction)
        return whole[:count][self._skin.owned_vertices], bodies

    def forces(self, nodes: Floats, motions: Floats) -> Floats:
        """Return the gradient of the barrier in N at all vertices of skin and bodies, (v, 3)."""
        x, _ = self._at(nodes, motions)
        return on_first_rank(self._comm, lambda: self._barrier.gradient(x))

    def _split(self, whole: Floats) -> list[tuple[int, Floats]]:
        """Return number and rows of each free body."""
        begin, found = len(self._skin.pattern.points), []
        for k, surface in enumerate(self._surfaces):
            if k in self._free:
                found.append((k, whole[begin : begin + len(surface)]))
            begin += len(surface)
        return found

    def _jacobian(self, k: int, pose: Floats) -> Floats:
        """Return the derivative of a body's vertices by its unknowns, (3 n, 6)."""
        body = self.contact.bodies[k]
        jacobian = pose_jacobian(self._surfaces[k], body.centre, pose)
        jacobian[:, 3:] /= body.radius
        return jacobian

    def _reduce(self, matrix: csc_matrix, poses: Floats) -> csc_matrix:
        """Return a matrix of all vertices as one of the unknowns of skin and free bodies."""
        count = 3 * len(self._skin.pattern.points)
        if not self._free:
            return matrix[:count, :count]
        parts = [identity(count, format="csc")]
        for k, surface in enumerate(self._surfaces):
            shape = (3 * len(surface), 0)
            free = k in self._free
            parts.append(csc_matrix(self._jacobian(k, poses[k]) if free else np.zeros(shape)))
        by = block_diag(parts, format="csc")
        return (by.T @ matrix @ by).tocsc()

    def _upper(self, matrix: csc_matrix) -> tuple[Ints, Floats]:
        """Return keys, row · size + column, and values of the entries of the upper triangle."""
        entries = matrix.tocoo()
        row, column = self._number[entries.row], self._number[entries.col]
        kept = (row >= 0) & (column >= row)
        return row[kept] * self._size + column[kept], entries.data[kept]

    def tangent(self, nodes: Floats, motions: Floats, *, definite: bool) -> Floats:
        """Return the entries of the second variation at `pairs` in N/m; none on other ranks.

        Args:
            nodes, motions: As of `energy`.
            definite: Whether to return a positive semidefinite part.
        """
        x, poses = self._at(nodes, motions)
        found = self._only_first(lambda: self._entries(x, poses, definite=definite))
        return np.zeros(0) if found is None else found

    def convexity_gap(self, nodes: Floats, motions: Floats) -> Floats | None:
        """Return the positive semidefinite `tangent` less the exact one; None if nothing touches.

        Args:
            nodes, motions: As of `energy`.
        """
        x, poses = self._at(nodes, motions)

        def entries() -> Floats:
            definite = self._entries(x, poses, definite=True)
            return np.asarray(definite - self._entries(x, poses, definite=False))

        if not self.count:
            return None
        found = self._only_first(entries)
        return np.zeros(0) if found is None else found

    def _entries(self, x: Floats, poses: Floats, *, definite: bool) -> Floats:
        keys, values = self._upper(self._second(x, poses, definite=definite))
        return np.bincount(np.searchsorted(self._keys, keys), values, len(self._keys))

    def _second(self, x: Floats, poses: Floats, *, definite: bool) -> csc_matrix:
        matrix = self._reduce(self._barrier.hessian(x, definite=definite), poses)
        if self._free and not definite:
            count, whole = 3 * len(self._skin.pattern.points), self._barrier.gradient(x)
            blocks = [csc_matrix((count, count))]
            for k, force in self._split(whole):
                body, scale = self.contact.bodies[k], np.ones(6)
                scale[3:] /= body.radius
                bend = pose_curvature(self._surfaces[k], body.centre, poses[k], force)
                blocks.append(csc_matrix(bend * np.outer(scale, scale)))
            matrix = matrix + block_diag(blocks, format="csc")
        return matrix

    def grow(self, nodes: Floats, motions: Floats) -> bool:
        """Let `pairs` cover all that is in contact; return whether they had to change."""
        x, poses = self._at(nodes, motions)

        def grown() -> bool:
            keys, _ = self._upper(self._second(x, poses, definite=False))
            keys = np.unique(keys)
            place = np.searchsorted(self._keys, keys)
            if (np.append(self._keys, -1)[place] == keys).all():
                return False
            near, _ = self._upper(self._reduce(self._barrier.near(x), poses))
            needed = np.union1d(keys, near)
            both = np.union1d(needed, self._keys)
            self._keys = both if len(both) <= STALE * len(needed) else needed
            self.pairs = np.stack(np.divmod(self._keys, self._size))
            return True

        return on_first_rank(self._comm, grown)

    def largest_step(
        self, nodes: Floats, motions: Floats, step: Floats, turn: Floats, allowed: float
    ) -> float:
        """Return a factor ≤ `allowed` on a step, so that nothing meets on the way.

        Args:
            nodes, motions: State: positions of the owned nodes in m, (n, 3), and unknowns of the
                free bodies, (f, 6), on the first rank.
            step, turn: Their change by the full step.
            allowed: Factor on the step that all else allows.
        """
        x, _ = self._at(nodes, motions)
        farthest = largest(self._comm, float(np.abs(step).max(initial=0.0)))
        angles = np.abs(turn[:, 3:]) / self._radius[:, None] if len(turn) else np.zeros(0)
        turned = largest(self._comm, float(angles.max(initial=0.0)))
        factor = min(
            allowed,
            FARTHEST * self._skin.pattern.size / max(farthest, 1e-300),
            LARGEST_TURN / max(turned, 1e-300),
        )
        y, _ = self._at(nodes + factor * step, motions + factor * turn)
        free = on_first_rank(self._comm, lambda: self._barrier.largest_step(x, y - x))
        return factor * free

    def crossed(self, nodes: Floats, motions: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""
        x, _ = self._at(nodes, motions)
        return on_first_rank(self._comm, lambda: self._barrier.crossed(x))
