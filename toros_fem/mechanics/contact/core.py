"""Contact on one process: barrier and friction, by the unknowns of skin and free bodies."""

from __future__ import annotations

import numpy as np
from scipy.sparse import block_array, block_diag, bsr_array, csc_matrix, csr_array, hstack, identity

from toros_fem.base.array_types import Floats, Ints
from toros_fem.mechanics.contact.barrier import Barrier
from toros_fem.mechanics.contact.free_bodies import FreeBodies, in_columns
from toros_fem.mechanics.contact.settings import ContactSizes
from toros_fem.mechanics.contact.sliding import SlidingFriction

# Entries of the tangent are kept until they are this many times those that are needed.
STALE = 2.0
# Stiffness of free bodies in the tangent over that of the sheet, E t.
NEUTRAL = 1e-8


class ContactCore:
    """Contact of a skin with itself, bodies and half-spaces, serial.

    Everywhere x are all vertices of skin and bodies in m, (v, 3), and poses those of all bodies,
    (k, 6). Forces and motions of the unknowns are those at the n vertices of the skin, (n, 3), and
    of the free bodies, (f, 6). With friction the barrier has sides of their own.

    Some motions of a free body may have no resistance, for instance the rotations of a sphere
    without friction. The tangent, and it alone, has the stiffness NEUTRAL E t for all motions of
    free bodies. Forces have no such part: balance is exact, a step does not move a body where no
    force acts, and an equilibrium that is neutral there counts as stable.

    Attributes:
        barrier: As given.
        keys: Entries row · size + column of the tangent that are kept, in global unknowns.
    """

    def __init__(
        self,
        barrier: Barrier,
        count: int,
        sizes: ContactSizes,
        bodies: FreeBodies,
        friction: SlidingFriction | None = None,
    ) -> None:
        self.barrier, self._count, self._sizes = barrier, count, sizes
        self._bodies, self._friction = bodies, friction
        # Second variation at a state, exact and semidefinite; friction by other normal forces has
        # another one.
        self._known_at: Floats | None = None
        self._known: dict[bool, tuple[Ints, Floats]] = {}

    def number(self, numbers: Ints, size: int) -> None:
        """Take the global numbers of all unknowns, −1 for fixed ones, and how many there are."""
        self._number, self._size = numbers, size
        # Free bodies have their entries in the tangent, whatever they touch.
        blocks = np.ones((self._bodies.count, 6, 6))
        self._body_keys, _ = self._upper(self._on_bodies(blocks))
        self.keys: Ints = np.unique(self._body_keys)

    @property
    def pairs(self) -> Ints:
        """Rows and columns of the entries that are kept, (2, p)."""
        return np.stack(np.divmod(self.keys, self._size))

    def energy(self, x: Floats, poses: Floats) -> float:
        """Return the energy of barrier and friction in J; infinite where surfaces are too near."""
        found = self.barrier.energy(x)
        if self._friction is not None and np.isfinite(found):
            found += self._friction.energy(x[: self._count], poses)
        return found

    def gradient(self, x: Floats, poses: Floats) -> tuple[Floats, Floats]:
        """Return its first variation in N by the unknowns."""
        skin, bodies = self._to_unknowns(self.barrier.gradient(x), poses)
        if self._friction is not None:
            force = self._friction.force(x[: self._count], poses)
            rubbed, turned = self._of_friction(force, poses)
            skin, bodies = skin + rubbed, bodies + turned
        return skin, bodies

    def _to_unknowns(self, whole: Floats, poses: Floats) -> tuple[Floats, Floats]:
        return whole[: self._count], self._bodies.reduced(poses, whole[self._count :])

    # Second variation.

    def entries(self, x: Floats, poses: Floats, *, definite: bool) -> Floats:
        """Return the second variation at `keys` in N/m, or a positive semidefinite part."""
        keys, values = self._second_upper(x, poses, definite=definite)
        found = np.isin(keys, self.keys)
        if not found.all():
            # The semidefinite part has entries where the exact one has zeros, which the toolkit
            # leaves out. Their sizes on the diagonal keep it semidefinite.
            ends = np.concatenate(np.divmod(keys[~found], self._size))
            keys = np.append(keys[found], ends * (self._size + 1))
            values = np.append(values[found], np.tile(np.abs(values[~found]), 2))
        places = np.searchsorted(self.keys, keys)
        return np.bincount(places, values, len(self.keys)).astype(np.float64)

    def grow(self, x: Floats, poses: Floats) -> bool:
        """Let `keys` cover all that is in contact; return whether they have changed."""
        keys = np.unique(self._second_upper(x, poses, definite=False)[0])
        place = np.searchsorted(self.keys, keys)
        if (np.append(self.keys, -1)[place] == keys).all():
            return False
        near, _ = self._upper(self._reduce(self.barrier.near(x), poses))
        needed = np.unique(np.concatenate([keys, near, self._body_keys]))
        diagonal = np.unique(np.divmod(needed, self._size)) * (self._size + 1)
        needed = np.union1d(needed, diagonal)
        both = np.union1d(needed, self.keys)
        self.keys = both if len(both) <= STALE * len(needed) else needed
        return True

    def _second_upper(self, x: Floats, poses: Floats, *, definite: bool) -> tuple[Ints, Floats]:
        """Return keys and values of the second variation, computed once for each state."""
        if self._known_at is None or not np.array_equal(self._known_at, x):
            self._known_at, self._known = x, {}
        if definite not in self._known:
            self._known[definite] = self._upper(self._second(x, poses, definite=definite))
        return self._known[definite]

    def _upper(self, matrix: csc_matrix) -> tuple[Ints, Floats]:
        """Return keys, row · size + column, and values of the entries of the upper triangle."""
        entries = matrix.tocoo()
        row, column = self._number[entries.row], self._number[entries.col]
        kept = (row >= 0) & (column >= row)
        return row[kept] * self._size + column[kept], entries.data[kept]

    def _reduce(self, matrix: csc_matrix, poses: Floats) -> csc_matrix:
        """Return a matrix of all vertices as one of the unknowns."""
        count = 3 * self._count
        if not self._bodies.count:
            return matrix[:count, :count]
        by = block_diag([identity(count), self._bodies.jacobian(poses)], format="csc")
        return (by.T @ matrix @ by).tocsc()

    def _on_bodies(self, blocks: Floats) -> csc_matrix:
        """Return a matrix of the unknowns with blocks of the free bodies, (f, 6, 6)."""
        skin = csr_array((3 * self._count, 3 * self._count))
        return csc_matrix(block_diag([skin, *map(csr_array, blocks)]))

    def _second(self, x: Floats, poses: Floats, *, definite: bool) -> csc_matrix:
        """Return the second variation, with a little stiffness of the free bodies."""
        matrix = self._reduce(self.barrier.hessian(x, definite=definite), poses)
        bodies, sizes = self._bodies, self._sizes
        if bodies.count:
            neutral = NEUTRAL * sizes.stiffness * sizes.thickness * np.eye(6)
            blocks = np.broadcast_to(neutral, (bodies.count, 6, 6))
            if not definite:
                blocks = blocks + bodies.curvature(poses, self.barrier.gradient(x)[self._count :])
            matrix = matrix + self._on_bodies(blocks)
        if self._friction is not None:
            matrix = matrix + self._friction_tangent(x, poses, definite=definite)
        return matrix

    def _friction_tangent(self, x: Floats, poses: Floats, *, definite: bool) -> csc_matrix:
        friction, skin = self._friction, x[: self._count]
        assert friction is not None
        stiffness = friction.stiffness(skin, poses)
        # All vertices have their blocks, so that the tangent's pattern does not depend on these.
        places = np.arange(len(skin) + 1)
        of_skin = bsr_array((stiffness.sum(axis=0), places[:-1], places))
        if not self._bodies.count:
            return csc_matrix(of_skin)
        by_bodies, count = self._by_bodies(poses), len(skin) * friction.sides
        places = np.arange(count + 1)
        stiff = bsr_array((stiffness.reshape(-1, 3, 3), places[:-1], places)) @ by_bodies
        across = hstack([identity(skin.size)] * friction.sides) @ stiff
        twice = by_bodies.T @ stiff
        if not definite:
            force, bodies = friction.force(skin, poses), self._bodies
            curvatures = [
                friction.pose_curvature(k, poses, force) * np.outer(scale, scale)
                for k, scale in zip(bodies.free, bodies.scale, strict=True)
            ]
            twice = twice - block_diag([*map(csr_array, curvatures)])
        return csc_matrix(block_array([[of_skin, across], [across.T, twice]]))

    def _by_bodies(self, poses: Floats) -> csr_array:
        """Return the derivative of ways from anchors, (3 · sides · n, 6 f), by free bodies."""
        friction, bodies, size = self._friction, self._bodies, 3 * self._count
        assert friction is not None
        blocks = [
            ((friction.grounds + k) * size, -friction.by_pose(k, poses) * scale)
            for k, scale in zip(bodies.free, bodies.scale, strict=True)
        ]
        return in_columns(friction.sides * size, blocks)

    # Friction.

    def begin(self) -> None:
        """Begin a step of a path: there are no normal forces yet."""
        self._known_at = None

    def lag(self, x: Floats, poses: Floats) -> None:
        """Let friction have the normal forces and tangent planes of a state."""
        assert self._friction is not None
        self._known_at = None
        self._friction.lag(self.barrier.normals(x), x[: self._count], poses)

    def end(self, x: Floats, poses: Floats) -> Floats:
        """Return where the vertices stick at the end of a step, by the normal forces there."""
        assert self._friction is not None
        self.lag(x, poses)
        return self._friction.end(x[: self._count], poses)

    def _of_friction(self, force: Floats, poses: Floats) -> tuple[Floats, Floats]:
        """Return forces of friction on each side, (sides, n, 3), as such on the unknowns."""
        return force.sum(axis=0), (self._by_bodies(poses).T @ force.ravel()).reshape(-1, 6)

    def coupling(
        self, x: Floats, poses: Floats, skin: Floats, turn: Floats, *, transposed: bool
    ) -> tuple[Floats, Floats]:
        """Return the change of friction by that of the normal forces, along the unknowns.

        x and poses are those of the last `lag`, skin and turn the change of the unknowns;
        `transposed` multiplies by the transpose.
        """
        friction, points = self._friction, x[: self._count]
        assert friction is not None
        if transposed:
            ways = self._by_bodies(poses) @ turn.ravel()
            given = skin + ways.reshape(friction.sides, -1, 3)
            by_normal = friction.force_backward(points, poses, given)
            return self._to_unknowns(self.barrier.normals_backward(x, by_normal), poses)
        moved = np.append(skin, self._bodies.jacobian(poses) @ turn.ravel())
        force = friction.force_change(points, poses, self.barrier.normals_change(x, moved))
        return self._of_friction(force, poses)
