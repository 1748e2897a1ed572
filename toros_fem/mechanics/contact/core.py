"""Contact on one process: barrier and friction, by the unknowns of skin and free bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import block_diag, coo_array, csc_matrix, identity

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.mechanics.contact.barrier import Barrier, Side
from toros_fem.mechanics.contact.free_bodies import FreeBodies
from toros_fem.mechanics.contact.neighbours import (
    collision_filter,
    neighbours,
    sizes_between_neighbours,
)
from toros_fem.mechanics.contact.settings import Contact, ContactSizes, Ground
from toros_fem.mechanics.contact.sliding import SlidingFriction
from toros_fem.meshes.pattern import Pattern

# Entries of the tangent are kept until they are this many times those that are needed.
STALE = 2.0
# Stiffness of free bodies in the tangent over that of the sheet, E t.
NEUTRAL = 1e-8


class ContactCore:
    """Contact of a skin with itself, bodies and half-spaces, serial.

    Everywhere x are all vertices of skin and bodies in m, (v, 3), and poses those of all bodies,
    (k, 6). Forces and motions of the unknowns are those at the vertices of the skin, (n, 3), and of
    the free bodies, (f, 6).

    Some motions of a free body may have no resistance, for instance the rotations of a sphere
    without friction. The tangent, and it alone, has the stiffness NEUTRAL E t for all motions of
    free bodies. Forces have no such part: balance is exact, a step does not move a body where no
    force acts, and an equilibrium that is neutral there counts as stable.

    Attributes:
        keys: Entries row · size + column of the tangent that are kept, in global unknowns.

    Args:
        pattern: Of the skin.
        contact, sizes: What touches, and its numbers.
        prescribed: Whether a vertex of the skin is fixed as a whole, (n,).
        bodies: Its bodies.
        friction: Its friction; None without.
    """

    def __init__(
        self,
        pattern: Pattern,
        contact: Contact,
        sizes: ContactSizes,
        prescribed: Bools,
        bodies: FreeBodies,
        friction: SlidingFriction | None,
    ) -> None:
        self._pattern, self._contact, self._sizes = pattern, contact, sizes
        self._bodies, self._friction = bodies, friction
        self._count = len(pattern.points)
        self._barrier = self._make_barrier(prescribed)
        self._owners: Ints = np.repeat(
            np.arange(1 + len(contact.bodies)), [self._count, *bodies.counts]
        )
        self._sides: list[Side] = []
        # Second variation at a state, exact and semidefinite; friction by other normal forces has
        # another one.
        self._known_at: Floats | None = None
        self._known: dict[bool, tuple[Ints, Floats]] = {}

    def _make_barrier(self, prescribed: Bools) -> Barrier:
        pattern, contact, bodies = self._pattern, self._contact, self._bodies
        count, sizes = self._count, self._sizes
        half = sizes.thickness / 2
        grounds = [
            Ground(tuple(np.add(g.point, half * np.array(g.normal))), g.normal)
            for g in contact.grounds
        ]
        made = bodies.vertices(np.zeros((len(contact.bodies), 6)))
        rest = np.concatenate([pattern.points, made])
        triangles = np.concatenate([pattern.triangles, bodies.triangles + count])
        areas = np.concatenate([pattern.areas, bodies.areas])

        def may_touch(apart: Ints) -> Any:
            return collision_filter(
                pattern,
                sizes,
                prescribed=prescribed,
                bodies=bodies.counts,
                free_bodies=contact.free_bodies,
                self_contact=contact.self_contact,
                apart=apart,
            )

        pairs: Ints = np.zeros((0, 2), dtype=np.int64)
        further = None
        if contact.self_contact:
            pairs = neighbours(pattern, sizes)
        if len(pairs):
            close = sizes_between_neighbours(pattern, sizes)
            further = Barrier(rest, triangles, areas, (), pairs[:0, 0], close, may_touch(pairs[:0]))
        standing = np.append(np.arange(count), count + bodies.moving)
        return Barrier(rest, triangles, areas, grounds, standing, sizes, may_touch(pairs), further)

    def number(self, numbers: Ints, size: int) -> None:
        """Take the global numbers of all unknowns, −1 for fixed ones, and how many there are."""
        self._number, self._size = numbers, size
        # Free bodies have their entries in the tangent, whatever they touch.
        blocks = np.ones((self._bodies.count, 6, 6))
        self._body_keys, _ = self._upper(_diagonal_blocks(3 * self._count, blocks))
        self.keys: Ints = np.unique(self._body_keys)

    @property
    def pairs(self) -> Ints:
        """Rows and columns of the entries that are kept, (2, p)."""
        return np.stack(np.divmod(self.keys, self._size))

    def _of_skin(self, whole: Floats) -> Floats:
        return whole[: self._count]

    def energy(self, x: Floats, poses: Floats) -> float:
        """Return the energy of barrier and friction in J; infinite where surfaces are too near."""
        found = self._barrier.energy(x)
        if self._friction is not None and np.isfinite(found):
            found += self._friction.energy(self._of_skin(x), poses)
        return found

    def gradient(self, x: Floats, poses: Floats) -> tuple[Floats, Floats]:
        """Return its first variation in N by the unknowns."""
        skin, bodies = self._to_unknowns(self._barrier.gradient(x), poses)
        if self._friction is not None:
            force = self._friction.force(self._of_skin(x), poses)
            skin = skin + force.sum(axis=0)
            bodies += self._pose_forces(force, poses)
        return skin, bodies

    def forces(self, x: Floats) -> Floats:
        """Return the gradient of the barrier in N at all vertices, (v, 3)."""
        return self._barrier.gradient(x)

    def gap(self, x: Floats) -> float:
        """Return the smallest distance of faces in m, as of `Barrier.gap`."""
        return self._barrier.gap(x)

    def count_pairs(self) -> int:
        """Return the number of pairs in contact at the last state."""
        return self._barrier.count

    def free_part(self, x: Floats, y: Floats) -> float:
        """Return the part of the straight way between vertices x and y on which nothing meets."""
        return self._barrier.largest_step(x, y - x)

    def refusal(self, x: Floats, names: Sequence[str]) -> str | None:
        """Return why a state can be no start; `names` are of the bodies of all their vertices."""
        found = self._barrier.check(x)
        return None if found.admissible else found.sentence(self._pattern, x, names)

    def crossed(self, x: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""
        return self._barrier.crossed(x)

    def _to_unknowns(self, whole: Floats, poses: Floats) -> tuple[Floats, Floats]:
        return self._of_skin(whole), self._bodies.reduced(poses, whole[self._count :])

    def _to_vertices(self, skin: Floats, bodies: Floats, poses: Floats) -> Floats:
        """Return motions of the unknowns as of all vertices."""
        moved = self._bodies.jacobian(poses) @ bodies.ravel()
        return np.concatenate([skin, moved.reshape(-1, 3)])

    def _pose_forces(self, force: Floats, poses: Floats) -> Floats:
        """Return the forces of friction on the unknowns of free bodies, (f, 6)."""
        assert self._friction is not None
        rows = [self._friction.pose_force(k, force, poses) for k in self._bodies.free]
        return np.reshape(rows, (-1, 6)) * self._bodies.scale

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

    def convexity_gap(self, x: Floats, poses: Floats) -> Floats:
        """Return the semidefinite `entries` less the exact ones."""
        definite = self.entries(x, poses, definite=True)
        return np.asarray(definite - self.entries(x, poses, definite=False))

    def grow(self, x: Floats, poses: Floats) -> bool:
        """Let `keys` cover all that is in contact; return whether they have changed."""
        keys = np.unique(self._second_upper(x, poses, definite=False)[0])
        place = np.searchsorted(self.keys, keys)
        if (np.append(self.keys, -1)[place] == keys).all():
            return False
        near, _ = self._upper(self._reduce(self._barrier.near(x), poses))
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

    def _second(self, x: Floats, poses: Floats, *, definite: bool) -> csc_matrix:
        """Return the second variation, with a little stiffness of the free bodies."""
        matrix = self._reduce(self._barrier.hessian(x, definite=definite), poses)
        bodies, sizes = self._bodies, self._sizes
        if bodies.count:
            neutral = NEUTRAL * sizes.stiffness * sizes.thickness * np.eye(6)
            blocks = np.broadcast_to(neutral, (bodies.count, 6, 6))
            if not definite:
                forces = self._barrier.gradient(x)[self._count :]
                blocks = blocks + bodies.curvature(poses, forces)
            matrix = (matrix + _diagonal_blocks(3 * self._count, blocks)).tocsc()
        if self._friction is not None:
            matrix = matrix + self._friction_tangent(x, poses, definite=definite)
        return matrix

    def _friction_tangent(self, x: Floats, poses: Floats, *, definite: bool) -> csc_matrix:
        assert self._friction is not None
        skin = self._of_skin(x)
        stiffness = self._friction.stiffness(skin, poses)
        first = 3 * np.arange(len(skin))[:, None, None]
        row, column = (first + axis for axis in np.indices((3, 3)))
        values = [stiffness.sum(axis=0).ravel()]
        rows, columns = [row.ravel()], [column.ravel()]
        force = self._friction.force(skin, poses)
        for place, k in enumerate(self._bodies.free):
            mixed, twice = self._friction.pose_stiffness(
                k, force, stiffness, poses, definite=definite
            )
            scale, begin = self._bodies.scale[place], 3 * len(skin) + 6 * place
            touching = np.flatnonzero(mixed.any(axis=(1, 2)))
            row = 3 * touching[:, None, None] + np.arange(3)[:, None]
            row, column = np.broadcast_arrays(row, begin + np.arange(6))
            values += 2 * [(mixed[touching] * scale).ravel()]
            rows += [row.ravel(), column.ravel()]
            columns += [column.ravel(), row.ravel()]
            row, column = begin + np.indices((6, 6))
            values.append((twice * np.outer(scale, scale)).ravel())
            rows.append(row.ravel())
            columns.append(column.ravel())
        size = 3 * len(skin) + 6 * self._bodies.count
        places = np.concatenate(rows), np.concatenate(columns)
        return csc_matrix((np.concatenate(values), places), shape=(size, size))

    # Friction.

    def begin(self) -> None:
        """Begin a step of a path: there are no normal forces yet."""
        self._sides, self._known_at = [], None

    def lag(self, x: Floats, poses: Floats) -> None:
        """Let friction have the normal forces and tangent planes of a state."""
        assert self._friction is not None
        self._known_at = None
        self._sides = self._barrier.sides(x, self._owners)
        self._friction.lag(self._pushes(self._sides), self._of_skin(x), poses)

    def normals(self, x: Floats) -> Floats:
        """Return the normal forces on the skin in N, (sides, n, 3), of half-spaces and bodies."""
        return self._pushes(self._barrier.sides(x, self._owners))

    def _pushes(self, sides: Sequence[Side]) -> Floats:
        return np.array([self._of_skin(side.push()) for side in sides])

    def coupling(
        self, x: Floats, poses: Floats, skin: Floats, turn: Floats, *, transposed: bool
    ) -> tuple[Floats, Floats]:
        """Return the change of friction by that of the normal forces, along the unknowns.

        Args:
            x, poses: State of the last `lag`.
            skin, turn: Change of the unknowns.
            transposed: Whether to multiply by the transpose.
        """
        assert self._friction is not None
        if transposed:
            changed = np.zeros_like(poses)
            changed[self._bodies.free] = turn * self._bodies.scale
            given = skin - self._friction.carried_change(poses, changed)
            by_normal, _ = self._friction.force_backward(self._of_skin(x), poses, given)
            return self._to_unknowns(self._pushed_back(by_normal), poses)
        moved = self._to_vertices(skin, turn, poses)
        normals = np.array([self._of_skin(s.push_change(moved)) for s in self._sides])
        force = self._friction.force_change(self._of_skin(x), poses, normals)
        return force.sum(axis=0), self._pose_forces(force, poses)

    def begin_backward(self, x: Floats, poses: Floats, adjoint: Floats) -> Floats:
        """Return Σ adjoint · d(force)/d(anchors at the begin), (sides, n, 3)."""
        assert self._friction is not None
        given = np.broadcast_to(adjoint, self._friction.normals.shape)
        return self._friction.force_backward(self._of_skin(x), poses, given)[1]

    def end_backward(self, x: Floats, poses: Floats, slope: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives of Σ slope · anchors at the end, by positions and by the begin."""
        assert self._friction is not None
        by_point, by_normal, by_anchor = self._friction.end_backward(self._of_skin(x), poses, slope)
        return by_point + self._of_skin(self._pushed_back(by_normal)), by_anchor

    def _pushed_back(self, by_normal: Floats) -> Floats:
        """Return derivatives by normal forces, (sides, n, 3), as such by all vertices."""
        whole = np.zeros((len(self._owners), 3))
        for side, part in zip(self._sides, by_normal, strict=True):
            given = np.zeros_like(whole)
            given[: len(part)] = part
            whole += side.push_change(given)
        return whole


def _diagonal_blocks(ahead: int, blocks: Floats) -> coo_array:
    """Return a matrix of blocks, (k, 6, 6), on the diagonal behind so many empty rows."""
    begin = ahead + 6 * np.arange(len(blocks))
    row, column = np.indices((6, 6))
    rows = (begin[:, None, None] + row).ravel()
    columns = (begin[:, None, None] + column).ravel()
    size = ahead + 6 * len(blocks)
    return coo_array((blocks.ravel(), (rows, columns)), shape=(size, size))
