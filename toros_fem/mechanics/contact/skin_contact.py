"""Contact of a distributed skin: the first rank finds the pairs, all ranks get the results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar, override

import numpy as np
from scipy.sparse import block_diag, coo_array, csc_matrix, identity

from toros_fem.base.array_types import Bools, Floats, Ints, LocalInts
from toros_fem.base.mpi import largest, on_first_rank, total
from toros_fem.mechanics.contact.barrier import Barrier, Side
from toros_fem.mechanics.contact.free_bodies import FreeBodies
from toros_fem.mechanics.contact.neighbours import (
    collision_filter,
    neighbours,
    sizes_between_neighbours,
)
from toros_fem.mechanics.contact.opening import opened
from toros_fem.mechanics.contact.settings import Contact, ContactSizes, Ground
from toros_fem.mechanics.contact.sliding import Sliding, SlidingFriction
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import Patch, Unknowns, blocks_of_first_rank, positions
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin

T = TypeVar("T")
# Entries of the tangent are kept until they are this many times those that are needed.
STALE = 2.0
# Stiffness of free bodies in the tangent over that of the sheet, E t.
NEUTRAL = 1e-8
# Way of a free body over the size of the skin at which it is taken to fall without end.
FALLEN = 3.0
# Largest motion of a step over the size of the skin: the space that longer ones sweep is full of
# pairs. Largest rotation of a body in rad: its vertices move straight in the search for pairs.
# Factor on a step that must be searched again.
FARTHEST, LARGEST_TURN, AGAIN = 0.1, 0.2, 0.9


class SkinContact(Term):
    """Energy, forces and tangent of a skin's contact with itself, bodies and half-spaces.

    Positions are gathered. The first rank computes, so that results do not depend on the number of
    ranks. Middle surfaces stay a thickness apart: the surfaces of bodies and ground are moved
    inwards by half of it. All methods are collective; x are the owned unknowns of a state.

    Some motions of a free body may have no resistance, for instance the rotations of a sphere
    without friction. The tangent, and it alone, has the stiffness NEUTRAL E t for all motions of
    free bodies. Forces have no such part: balance is exact, a step does not move a body where no
    force acts, and an equilibrium that is neutral there counts as stable.

    Attributes:
        contact, sizes: As given.
        poses: Poses of all bodies, (k, 6), of those without unknowns as the load has them.
        assembled: Assembled positions of all vertices in m, (n, 3); layers that touch each other
            are moved apart.

    Args:
        skin: The skin.
        contact: What touches.
        sizes: Its numbers.
        fixed: Fixed components of all vertices, (n, 3).
        in_planes: Whether a vertex lies in a symmetry plane across x, y or z, (n, 3).
    """

    def __init__(
        self,
        skin: Skin,
        contact: Contact,
        sizes: ContactSizes,
        fixed: Bools,
        in_planes: Bools,
    ) -> None:
        self._skin, self._comm, self._fixed = skin, skin.comm, fixed
        self.contact, self.sizes = contact, sizes
        self._bodies = FreeBodies(contact, sizes.thickness)
        self._neutral = NEUTRAL * sizes.stiffness * sizes.thickness
        self.poses: Floats = np.zeros((len(contact.bodies), 6))
        self._weight_fraction = 0.0
        if self._bodies.count:
            bodies = blocks_of_first_rank(self._comm, self._bodies.count)
            self.unknowns = Unknowns(bodies, np.zeros((self._bodies.count, 6), dtype=bool))
        self._sides: list[Side] = []
        # Second variation at a state, exact and semidefinite; friction by other normal forces has
        # another one.
        self._known_at: Floats | None = None
        self._known: dict[bool, tuple[Ints, Floats]] = {}
        self.friction: SlidingFriction | None = None
        if contact.holds:
            self.friction = SlidingFriction(contact, sizes)
        self._owners: Ints = np.repeat(
            np.arange(1 + len(contact.bodies)), [len(skin.pattern.points), *self._bodies.counts]
        )
        made = self._only_first(lambda: self._make_barrier(np.asarray(fixed.all(axis=1))))
        if made is not None:
            self._barrier = made
        self.assembled: Floats = skin.pattern.points
        if contact.self_contact:
            self.assembled = on_first_rank(
                self._comm, lambda: opened(skin.pattern, sizes, in_planes)
            )

    @override
    def number(self, patch: Patch, dofs: LocalInts) -> None:
        index_map = patch.space.dofmap.index_map
        self._size, self._dofs = index_map.size_global, dofs.reshape(-1, 6)
        whole = self._skin.gather_vertices(patch.numbers.astype(np.float64)).astype(np.int64)
        whole[self._fixed] = -1
        self._number = np.append(whole.ravel(), index_map.local_to_global(dofs.ravel()))
        # Free bodies have their entries in the tangent, whatever they touch.
        blocks = np.ones((self._bodies.count * (self._comm.rank == 0), 6, 6))
        self._body_keys, _ = self._upper(_diagonal_blocks(whole.size, blocks))
        self._cover(self._body_keys)

    @override
    def set_load(self, load: Load) -> None:
        self.poses[:] = 0.0 if load.poses is None else load.poses
        self._weight_fraction = load.weight_of_bodies

    @override
    def add_rest(self, x: Floats) -> None:
        positions(self._skin, x)[:] = self.assembled[self._skin.owned_vertices]

    @property
    def free_bodies(self) -> int:
        """Number of free bodies."""
        return self._bodies.count

    def motions(self, x: Floats) -> Floats:
        """Return the unknowns of the free bodies in m, (f, 6); zero on all ranks but the first."""
        return x[self._dofs] if self._comm.rank == 0 else np.zeros(self._dofs.shape)

    def set_motions(self, x: Floats, motions: Floats) -> None:
        """Write the unknowns of the free bodies, which all ranks but the first ignore."""
        if self._comm.rank == 0:
            x[self._dofs] = motions

    def with_short_turns(self, x: Floats) -> Floats:
        """Return the same places, with rotations of free bodies of at most π."""
        x = x.copy()
        self.set_motions(x, self._bodies.shortest(self.motions(x)))
        return x

    def falls(self, x: Floats) -> bool:
        """Return whether a free body is so far away that nothing will hold it any more."""
        way = largest(self._comm, float(np.abs(self.motions(x)[:, :3]).max(initial=0.0)))
        return way > FALLEN * self._skin.pattern.size

    def _only_first(self, action: Callable[[], T]) -> T | None:
        """Run an action on the first rank; raise its error on all."""
        kept: list[T] = []
        on_first_rank(self._comm, lambda: kept.append(action()))
        return kept[0] if kept else None

    def _make_barrier(self, prescribed: Bools) -> Barrier:
        pattern, contact = self._skin.pattern, self.contact
        bodies, count = self._bodies, len(pattern.points)
        half = self.sizes.thickness / 2
        grounds = [
            Ground(tuple(np.add(g.point, half * np.array(g.normal))), g.normal)
            for g in contact.grounds
        ]
        rest = np.concatenate([pattern.points, bodies.vertices(np.zeros_like(self.poses))])
        triangles = np.concatenate([pattern.triangles, bodies.triangles + count])
        areas = np.concatenate([pattern.areas, bodies.areas])

        def may_touch(apart: Ints) -> Any:
            return collision_filter(
                pattern,
                self.sizes,
                prescribed=prescribed,
                bodies=bodies.counts,
                free_bodies=contact.free_bodies,
                self_contact=contact.self_contact,
                apart=apart,
            )

        pairs: Ints = np.zeros((0, 2), dtype=np.int64)
        further = None
        if contact.self_contact:
            pairs = neighbours(pattern, self.sizes)
        if len(pairs):
            close = sizes_between_neighbours(pattern, self.sizes)
            further = Barrier(rest, triangles, areas, (), pairs[:0, 0], close, may_touch(pairs[:0]))
        standing = np.append(np.arange(count), count + bodies.moving)
        return Barrier(
            rest, triangles, areas, grounds, standing, self.sizes, may_touch(pairs), further
        )

    def poses_of(self, x: Floats) -> Floats:
        """Return the poses of all bodies in a state, (k, 6), in m and rad."""
        return self._bodies.poses(self._comm.bcast(self.motions(x), root=0), self.poses)

    def _at(self, x: Floats) -> tuple[Floats, Floats]:
        """Return all vertices of skin and bodies on every rank, and the poses (collective)."""
        skin, poses = self._skin.gather_vertices(positions(self._skin, x)), self.poses_of(x)
        everything = np.concatenate([skin, self._bodies.vertices(poses)])
        return np.asfortranarray(everything), poses

    @override
    def energy(self, x: Floats) -> float:
        """Return barrier energy less the work of the bodies' weight, in J, and with friction.

        Friction has the normal forces of the last `lag_friction`. The energy is infinite where
        surfaces are too near to each other.
        """
        every, poses = self._at(x)

        def on_first() -> float:
            found = self._barrier.energy(every)
            if self.friction is not None and np.isfinite(found):
                found += self.friction.energy(self._of_skin(every), poses)
            return found

        barrier = on_first_rank(self._comm, on_first)
        return barrier - self._weight_fraction * self._bodies.work(poses)

    def gap(self, x: Floats) -> float:
        """Return the smallest distance of faces in m, at most that from which on contact acts."""
        every, _ = self._at(x)
        return on_first_rank(self._comm, lambda: self._barrier.gap(every))

    def count_pairs(self) -> int:
        """Return the number of pairs in contact at the last state (collective)."""
        return on_first_rank(self._comm, lambda: self._barrier.count)

    @override
    def add_gradient(self, x: Floats, out: Floats) -> None:
        every, poses = self._at(x)

        def on_first() -> tuple[Floats, Floats]:
            whole = self._barrier.gradient(every)
            skin, bodies = self._to_unknowns(whole, poses)
            if self.friction is not None:
                force = self.friction.force(self._of_skin(every), poses)
                skin = skin + force.sum(axis=0)
                bodies += self._pose_forces(force, poses)
            return skin, bodies

        skin, bodies = on_first_rank(self._comm, on_first)
        self._add(out, skin, bodies - self._weight_fraction * self._bodies.weight)

    def _add(self, out: Floats, skin: Floats, bodies: Floats) -> None:
        """Add forces on all vertices of the skin, (n, 3), and on the free bodies, (f, 6)."""
        positions(self._skin, out)[:] += skin[self._skin.owned_vertices]
        if self._comm.rank == 0:
            out[self._dofs] += bodies

    @override
    def add_applied(self, x: Floats, out: Floats) -> None:
        if self._comm.rank == 0:
            out[self._dofs] += self._weight_fraction * self._bodies.weight

    @override
    def load_energy(self, x: Floats) -> float:
        weight = self._weight_fraction * self._bodies.weight
        return total(self._comm, float(np.abs(weight * self.motions(x)).sum()))

    def _of_skin(self, whole: Floats) -> Floats:
        return whole[: len(self._skin.pattern.points)]

    def _to_unknowns(self, whole: Floats, poses: Floats) -> tuple[Floats, Floats]:
        """Return forces on all vertices as those on the skin, (n, 3), and on free bodies."""
        return self._of_skin(whole), self._bodies.reduced(
            poses, whole[len(self._skin.pattern.points) :]
        )

    def _to_vertices(self, skin: Floats, bodies: Floats, poses: Floats) -> Floats:
        """Return motions of the skin, (n, 3), and of free bodies' unknowns as of all vertices."""
        moved = self._bodies.jacobian(poses) @ bodies.ravel()
        return np.concatenate([skin, moved.reshape(-1, 3)])

    def _pose_forces(self, force: Floats, poses: Floats) -> Floats:
        """Return the forces of friction on the unknowns of free bodies, (f, 6)."""
        assert self.friction is not None
        rows = [self.friction.pose_force(k, force, poses) for k in self._bodies.free]
        return np.reshape(rows, (-1, 6)) * self._bodies.scale

    def forces(self, x: Floats) -> Floats:
        """Return the gradient of the barrier in N at all vertices of skin and bodies, (v, 3)."""
        every, _ = self._at(x)
        return on_first_rank(self._comm, lambda: self._barrier.gradient(every))

    def _reduce(self, matrix: csc_matrix, poses: Floats) -> csc_matrix:
        """Return a matrix of all vertices as one of the unknowns of skin and free bodies."""
        count = 3 * len(self._skin.pattern.points)
        if not self._bodies.count:
            return matrix[:count, :count]
        by = block_diag([identity(count), self._bodies.jacobian(poses)], format="csc")
        return (by.T @ matrix @ by).tocsc()

    def _upper(self, matrix: csc_matrix) -> tuple[Ints, Floats]:
        """Return keys, row · size + column, and values of the entries of the upper triangle."""
        entries = matrix.tocoo()
        row, column = self._number[entries.row], self._number[entries.col]
        kept = (row >= 0) & (column >= row)
        return row[kept] * self._size + column[kept], entries.data[kept]

    @override
    def entries(self, x: Floats, *, definite: bool) -> Floats:
        every, poses = self._at(x)
        found = self._only_first(lambda: self._entries(every, poses, definite=definite))
        return np.zeros(0) if found is None else found

    def convexity_gap(self, x: Floats) -> Floats | None:
        """Return the semidefinite `entries` less the exact ones; None if nothing touches."""
        every, poses = self._at(x)

        def gap() -> Floats:
            definite = self._entries(every, poses, definite=True)
            return np.asarray(definite - self._entries(every, poses, definite=False))

        if not self.count_pairs():
            return None
        found = self._only_first(gap)
        return np.zeros(0) if found is None else found

    def _entries(self, x: Floats, poses: Floats, *, definite: bool) -> Floats:
        keys, values = self._second_upper(x, poses, definite=definite)
        found = np.isin(keys, self._keys)
        if not found.all():
            # The semidefinite part has entries where the exact one has zeros, which the toolkit
            # leaves out. Their sizes on the diagonal keep it semidefinite.
            ends = np.concatenate(np.divmod(keys[~found], self._size))
            keys = np.append(keys[found], ends * (self._size + 1))
            values = np.append(values[found], np.tile(np.abs(values[~found]), 2))
        places = np.searchsorted(self._keys, keys)
        return np.bincount(places, values, len(self._keys)).astype(np.float64)

    def _second_upper(self, x: Floats, poses: Floats, *, definite: bool) -> tuple[Ints, Floats]:
        """Return keys and values of the second variation, computed once for each state."""
        if self._known_at is None or not np.array_equal(self._known_at, x):
            self._known_at, self._known = x, {}
        if definite not in self._known:
            self._known[definite] = self._upper(self._second(x, poses, definite=definite))
        return self._known[definite]

    def _second(self, x: Floats, poses: Floats, *, definite: bool) -> csc_matrix:
        """Return the second variation, with a little stiffness of the free bodies."""
        matrix = self._reduce(self._barrier.hessian(x, definite=definite), poses)
        if self._bodies.count:
            count = len(self._skin.pattern.points)
            blocks = np.broadcast_to(self._neutral * np.eye(6), (self._bodies.count, 6, 6))
            if not definite:
                blocks = blocks + self._bodies.curvature(poses, self._barrier.gradient(x)[count:])
            matrix = (matrix + _diagonal_blocks(3 * count, blocks)).tocsc()
        if self.friction is not None:
            matrix = matrix + self._friction_tangent(x, poses, definite=definite)
        return matrix

    def _friction_tangent(self, x: Floats, poses: Floats, *, definite: bool) -> csc_matrix:
        assert self.friction is not None
        skin = self._of_skin(x)
        stiffness = self.friction.stiffness(skin, poses)
        first = 3 * np.arange(len(skin))[:, None, None]
        row, column = (first + axis for axis in np.indices((3, 3)))
        values = [stiffness.sum(axis=0).ravel()]
        rows, columns = [row.ravel()], [column.ravel()]
        force = self.friction.force(skin, poses)
        for place, k in enumerate(self._bodies.free):
            mixed, twice = self.friction.pose_stiffness(
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

    @property
    def slides(self) -> bool:
        """Whether there is friction, by which the residual has no potential."""
        return self.friction is not None

    def begin_step(self, sliding: Sliding | None, load: Load) -> None:
        """Begin a step of a path with friction; without friction nothing is done.

        Args:
            sliding: End of the step before; None for a skin at rest at its assembled positions.
            load: Load of the step.
        """
        if self.friction is None:
            return
        poses = load.poses
        if sliding is None:
            begin = np.zeros_like(self.poses) if poses is None else poses.copy()
            begin[self._bodies.free] = 0.0
            sliding = self.friction.at_rest(self.assembled, begin)
        self.friction.begin(sliding)
        self._sides, self._known_at = [], None

    def lag_friction(self, x: Floats) -> None:
        """Let friction have the normal forces and tangent planes of a state."""
        if self.friction is None:
            return
        every, poses = self._at(x)

        def on_first() -> None:
            assert self.friction is not None
            self._known_at = None
            self._sides = self._barrier.sides(every, self._owners)
            self.friction.lag(self._pushes(self._sides), self._of_skin(every), poses)

        on_first_rank(self._comm, on_first)

    def normals(self, x: Floats) -> Floats:
        """Return the normal forces on the skin in N, (sides, n, 3), of half-spaces and bodies."""
        every, _ = self._at(x)

        return on_first_rank(
            self._comm, lambda: self._pushes(self._barrier.sides(every, self._owners))
        )

    def _pushes(self, sides: Sequence[Side]) -> Floats:
        return np.array([self._of_skin(side.push()) for side in sides])

    def end_step(self, x: Floats) -> Sliding | None:
        """Return where the vertices stick at the end of a step; None without friction."""
        if self.friction is None:
            return None
        self.lag_friction(x)
        every, poses = self._at(x)
        friction = self.friction
        return on_first_rank(self._comm, lambda: friction.end(self._of_skin(every), poses))

    def coupling(self, x: Floats, change: Floats, *, transposed: bool = False) -> Floats:
        """Return the change of friction by that of the normal forces: the part without symmetry.

        Args:
            x: State of the last `lag_friction`.
            change: Change of the state.
            transposed: Whether to multiply by the transpose.
        """
        every, poses = self._at(x)
        whole = self._skin.gather_vertices(positions(self._skin, change))
        turn = self._comm.bcast(self.motions(change), root=0)

        def on_first() -> tuple[Floats, Floats]:
            assert self.friction is not None
            if transposed:
                given = self._on_sides(whole, turn, poses)
                by_normal, _ = self.friction.force_backward(self._of_skin(every), poses, given)
                return self._to_unknowns(self._pushed_back(by_normal), poses)
            moved = self._to_vertices(whole, turn, poses)
            normals = np.array([self._of_skin(s.push_change(moved)) for s in self._sides])
            force = self.friction.force_change(self._of_skin(every), poses, normals)
            return force.sum(axis=0), self._pose_forces(force, poses)

        out = np.zeros_like(x)
        self._add(out, *on_first_rank(self._comm, on_first))
        return out

    def _on_sides(self, skin: Floats, turn: Floats, poses: Floats) -> Floats:
        """Return how far each vertex moves along each side, (sides, n, 3)."""
        assert self.friction is not None
        poses_change = np.zeros_like(poses)
        poses_change[self._bodies.free] = turn * self._bodies.scale
        return skin - self.friction.carried_change(poses, poses_change)

    def _pushed_back(self, by_normal: Floats) -> Floats:
        """Return derivatives by normal forces, (sides, n, 3), as such by all vertices."""
        whole = np.zeros((len(self._owners), 3))
        for side, part in zip(self._sides, by_normal, strict=True):
            given = np.zeros_like(whole)
            given[: len(part)] = part
            whole += side.push_change(given)
        return whole

    def begin_step_backward(self, x: Floats, adjoint: Floats) -> Floats:
        """Return Σ adjoint · d(force)/d(anchors at the begin), (sides, n, 3), on all ranks.

        Args:
            x: State of the last `lag_friction`.
            adjoint: Owned unknowns.
        """
        every, poses = self._at(x)
        whole = self._skin.gather_vertices(positions(self._skin, adjoint))

        def on_first() -> Floats:
            assert self.friction is not None
            given = np.broadcast_to(whole, self.friction.normals.shape)
            return self.friction.force_backward(self._of_skin(every), poses, given)[1]

        return on_first_rank(self._comm, on_first)

    def end_step_backward(self, x: Floats, slope: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives of Σ slope · anchors at the end, by state and by the begin.

        Args:
            x: State of the last `lag_friction`.
            slope: Numbers for each anchor, (sides, n, 3), equal on all ranks.
        """
        every, poses = self._at(x)

        def on_first() -> tuple[Floats, Floats]:
            assert self.friction is not None
            skin = self._of_skin(every)
            by_point, by_normal, by_anchor = self.friction.end_backward(skin, poses, slope)
            return by_point + self._of_skin(self._pushed_back(by_normal)), by_anchor

        skin, by_anchor = on_first_rank(self._comm, on_first)
        out = np.zeros_like(x)
        positions(self._skin, out)[:] = skin[self._skin.owned_vertices]
        return out, by_anchor

    def _cover(self, keys: Ints) -> None:
        """Let `pairs` be those of the given keys."""
        self._keys = np.unique(keys)
        self.pairs = np.stack(np.divmod(self._keys, self._size))

    @override
    def grow(self, x: Floats) -> None:
        """Let `pairs` cover all that is in contact."""
        every, poses = self._at(x)

        def grown() -> bool:
            keys = np.unique(self._second_upper(every, poses, definite=False)[0])
            place = np.searchsorted(self._keys, keys)
            if (np.append(self._keys, -1)[place] == keys).all():
                return False
            near, _ = self._upper(self._reduce(self._barrier.near(every), poses))
            needed = np.unique(np.concatenate([keys, near, self._body_keys]))
            diagonal = np.unique(np.divmod(needed, self._size)) * (self._size + 1)
            needed = np.union1d(needed, diagonal)
            both = np.union1d(needed, self._keys)
            self._cover(both if len(both) <= STALE * len(needed) else needed)
            return True

        self.generation += on_first_rank(self._comm, grown)

    @override
    def largest_step(self, x: Floats, step: Floats, factor: float, carried: Floats | None) -> float:
        """Return a factor on a step, at most the given one, so that nothing meets on the way."""
        every, _ = self._at(x)
        turn = self.motions(step)
        poses = self.poses.copy()
        moved = np.zeros_like(poses) if carried is None else carried
        farthest = max(
            np.abs(part).max(initial=0.0)
            for part in (positions(self._skin, step), turn[:, :3], moved[:, :3])
        )
        farthest = largest(self._comm, float(farthest))
        turned = largest(self._comm, self._bodies.largest_angle(turn))
        turned = max(turned, float(np.linalg.norm(moved[:, 3:], axis=1).max(initial=0.0)))
        factor = min(
            factor,
            FARTHEST * self._skin.pattern.size / max(farthest, 1e-300),
            LARGEST_TURN / max(turned, 1e-300),
        )
        free = 0.0
        while free < 1 and factor > 0:
            self.poses[:] = poses + factor * moved
            there, _ = self._at(x + factor * step)
            free = self._free_part(every, there)
            factor *= free
            if turned == 0:
                break
            # Where a body turns, a part of the step ends beside the straight way: look again.
            factor *= 1.0 if free == 1 else AGAIN
        self.poses[:] = poses
        return factor

    def _free_part(self, x: Floats, y: Floats) -> float:
        """Return the part of the straight way between vertices x and y on which nothing meets."""
        return on_first_rank(self._comm, lambda: self._barrier.largest_step(x, y - x))

    @override
    def refusal(self, x: Floats) -> str | None:
        """Return why a state can be no start, as a sentence; None where it can."""
        every, _ = self._at(x)
        bodies = zip(self.contact.bodies, self._bodies.counts, strict=True)
        names = [body.name for body, count in bodies for _ in range(count)]

        def sentence() -> str | None:
            found = self._barrier.check(every)
            return None if found.admissible else found.sentence(self._skin.pattern, every, names)

        return on_first_rank(self._comm, sentence)

    def crossed(self, x: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""
        every, _ = self._at(x)
        return on_first_rank(self._comm, lambda: self._barrier.crossed(every))


def _diagonal_blocks(ahead: int, blocks: Floats) -> coo_array:
    """Return a matrix of blocks, (k, 6, 6), on the diagonal behind so many empty rows."""
    begin = ahead + 6 * np.arange(len(blocks))
    row, column = np.indices((6, 6))
    rows = (begin[:, None, None] + row).ravel()
    columns = (begin[:, None, None] + column).ravel()
    size = ahead + 6 * len(blocks)
    return coo_array((blocks.ravel(), (rows, columns)), shape=(size, size))
