"""Contact of a skin with itself, ground and bodies: what is given, and the term of the energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar, override

import numpy as np
from scipy.sparse import block_array, block_diag, bsr_array, csc_matrix, csr_array, hstack, identity

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import OnFirst, largest, on_first_rank
from toros_fem.base.validation import (
    Bools,
    Floats,
    Ints,
    LocalInts,
    checked_list,
    checked_names,
    require_flag,
    require_kind,
    require_positive,
)
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.barrier import Barrier
from toros_fem.mechanics.contact.bodies import FreeBodies, Ground, RigidBody, in_columns
from toros_fem.mechanics.contact.layers import ContactSizes, opened
from toros_fem.mechanics.contact.sliding import Pads, SlidingFriction
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import Patch, Unknowns, blocks_of_first_rank, positions
from toros_fem.mechanics.skin.supports import Planes, Supports
from toros_fem.mechanics.terms.term import ContactSettings, ContactTerm, Term
from toros_fem.meshes.skin import Skin

T = TypeVar("T")


# Distance within which contact acts, over the thickness.
RANGE = 0.5
# Largest motion of a step over the size of the skin: the space that longer ones sweep is full of
# pairs. Largest rotation of a body in rad: its vertices move straight in the search for pairs.
# Factor on a step that must be searched again.
FARTHEST, LARGEST_TURN, AGAIN = 0.1, 0.2, 0.9
# Entries of the tangent on all ranks but the first.
NOTHING: Floats = np.zeros(0)
# Entries of the tangent are kept until they are this many times those that are needed.
STALE = 2.0
# Stiffness of free bodies in the tangent over that of the sheet, E t.
NEUTRAL = 1e-8


@dataclass(frozen=True, eq=False)
class Contact(ContactSettings):
    """Contact of a skin with itself, the ground and rigid bodies.

    Faces keep their distance by the barriers of incremental potential contact (Li et al. 2020):
    contact acts from `distance` on and grows without bound towards zero. The distance is that of
    the faces of sheets with `thickness`: middle surfaces stay a whole thickness apart, and half of
    it from bodies and ground. Both are lengths of the sheet, not of the mesh.

    Attributes:
        ground: The ground, or several half-spaces; None for none.
        bodies: Rigid bodies: held, moved with the load, or free.
        self_contact: Whether the skin's layers touch each other.
        friction: Coefficient μ of Coulomb's friction of the skin on ground and bodies; None for
            none. Layers of the skin slide on each other without friction, and so do bodies on each
            other and on the ground.
        pads: Vertices that slide on the ground by coefficients of their own; None for none.
        thickness: In m, which the sheet takes up between its faces; None takes the fabric's.
        distance: In m, from which on contact acts; None takes half of the thickness.
        stiffness: In Pa, the scale of the contact pressure: it is reached where the distance has
            shrunk by about a half; None takes the fabric's E.
        slip: In m, the tangential motion at which friction is fully mobilised; None takes
            `distance`.
    """

    ground: Ground | Sequence[Ground] | None = None
    bodies: Sequence[RigidBody] = ()
    self_contact: bool = True
    friction: float | None = None
    pads: Pads | None = None
    thickness: float | None = None
    distance: float | None = None
    stiffness: float | None = None
    slip: float | None = None

    def __post_init__(self) -> None:
        grounds = () if self.ground is None else self.ground
        if isinstance(grounds, Ground):
            grounds = (grounds,)
        what = "Grounds, by Ground(point, normal), or None"
        object.__setattr__(self, "ground", checked_list("ground", grounds, Ground, what))
        what = "RigidBodies, by rigid_sphere for instance"
        object.__setattr__(self, "bodies", checked_list("bodies", self.bodies, RigidBody, what))
        checked_names("names of bodies", [body.name for body in self.bodies])
        require_flag(self_contact=self.self_contact)
        names = ["friction", "thickness", "distance", "stiffness", "slip"]
        given = {name: getattr(self, name) for name in names}
        require_positive(**{name: size for name, size in given.items() if size is not None})
        require_kind("pads", self.pads, (Pads, type(None)), "Pads, or None")
        if self.pads is not None and (not self.ground or self.friction is None):
            raise ParameterError(
                "pads slide on the ground, and all other faces have friction: give ground and "
                "friction, or leave the pads out."
            )
        if not (self.ground or self.bodies or self.self_contact):
            raise ParameterError(
                "this contact touches nothing: give ground or bodies, set self_contact, or give "
                "no contact at all."
            )

    @property
    def grounds(self) -> tuple[Ground, ...]:
        """All half-spaces."""
        assert isinstance(self.ground, tuple)
        return self.ground

    @property
    @override
    def holds(self) -> bool:
        # It rubs on ground or body.
        return self.friction is not None and bool(self.ground or self.bodies)

    @override
    def term(self, skin: Skin, composite: Composite, supports: Supports) -> SkinContact:
        in_planes = Planes(skin.pattern, supports).of_symmetry()
        return SkinContact(skin, self, self.sizes(composite), supports.fixed, in_planes)

    def sizes(self, composite: Composite) -> ContactSizes:
        """Return thickness, distance, stiffness and slip, each as given or as the sheet has it."""
        fabric = composite.fabric
        thickness = fabric.thickness if self.thickness is None else self.thickness
        distance = RANGE * thickness if self.distance is None else self.distance
        return ContactSizes(
            thickness,
            distance,
            fabric.young if self.stiffness is None else self.stiffness,
            distance if self.slip is None else self.slip,
        )


class SkinContact(ContactTerm):
    """Energy, forces and tangent of a skin's contact with itself, bodies and half-spaces.

    Positions are gathered, and the first rank computes (`ContactCore`), so that results do not
    depend on the number of ranks. Middle surfaces stay a thickness apart: the surfaces of bodies
    and ground are moved inwards by half of it. All methods are collective; x are the owned unknowns
    of a state. Fixed components and symmetry planes are those of all vertices, (n, 3).

    Attributes:
        contact, sizes: As given.
        friction: Friction of the skin on ground and bodies; None without.
        assembled: Assembled positions of all vertices in m, (n, 3); layers that touch each other
            are moved apart.
    """

    symbols = ()

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
        self.distance, self.self_contact = sizes.distance, contact.self_contact
        self._bodies = bodies = FreeBodies(contact.bodies, sizes.thickness)
        self.free_bodies = bodies.count
        self.poses: Floats = np.zeros((len(contact.bodies), 6))
        if bodies.count:
            blocks = blocks_of_first_rank(self._comm, bodies.count)
            self.unknowns = Unknowns(blocks, np.zeros((bodies.count, 6), dtype=bool))
        self.friction = friction = _friction(contact, sizes)
        self.slides = friction is not None
        pattern, prescribed = skin.pattern, np.asarray(fixed.all(axis=1))

        def make() -> ContactCore:
            barrier = Barrier(
                pattern,
                contact.grounds,
                bodies,
                sizes,
                prescribed,
                self_contact=contact.self_contact,
                by_side=self.slides,
            )
            return ContactCore(barrier, len(pattern.points), sizes, bodies, friction)

        self._core = OnFirst(self._comm, make)
        self.assembled: Floats = pattern.points
        if contact.self_contact:
            self.assembled = on_first_rank(self._comm, lambda: opened(pattern, sizes, in_planes))

    @override
    def number(self, patch: Patch, dofs: LocalInts) -> None:
        index_map = patch.space.dofmap.index_map
        self._dofs = dofs.reshape(-1, 6)
        whole = self._skin.gather_vertices(patch.numbers.astype(np.float64)).astype(np.int64)
        whole[self._fixed] = -1
        numbers: Ints = np.append(whole.ravel(), index_map.local_to_global(dofs.ravel()))
        self._core(lambda core: core.number(numbers, index_map.size_global))
        self._take_pairs()

    def _take_pairs(self) -> None:
        self.pairs = self._core.alone(lambda core: core.pairs, Term.pairs)

    @override
    def set_load(self, load: Load) -> None:
        self.poses[:] = 0.0 if load.poses is None else load.poses

    @override
    def add_rest(self, x: Floats) -> None:
        positions(self._skin, x)[:] = self.assembled[self._skin.owned_vertices]

    def motions(self, x: Floats) -> Floats:
        """Return the unknowns of the free bodies in m, (f, 6); zero on all ranks but the first."""
        return x[self._dofs] if self._comm.rank == 0 else np.zeros(self._dofs.shape)

    @override
    def set_motions(self, x: Floats, motions: Floats) -> None:
        if self._comm.rank == 0:
            x[self._dofs] = motions

    @override
    def with_short_turns(self, x: Floats) -> Floats:
        x = x.copy()
        self.set_motions(x, self._bodies.shortest(self.motions(x)))
        return x

    @override
    def reach(self, change: Floats) -> float:
        moved = float(np.abs(change[:, :3]).max(initial=0.0))
        pairs = zip(change, self.contact.bodies, strict=True)
        return max([moved, *(float(np.linalg.norm(c[3:]) * b.radius) for c, b in pairs)])

    @override
    def poses_of(self, x: Floats) -> Floats:
        return self._poses(x, self.poses)

    def _poses(self, x: Floats, held: Floats) -> Floats:
        return self._bodies.poses(self._comm.bcast(self.motions(x), root=0), held)

    def _at(self, x: Floats) -> tuple[Floats, Floats]:
        """Return all vertices of skin and bodies on every rank, and the poses."""
        poses = self.poses_of(x)
        return self._vertices(x, poses), poses

    def _vertices(self, x: Floats, poses: Floats) -> Floats:
        skin = self._skin.gather_vertices(positions(self._skin, x))
        return np.asfortranarray(np.concatenate([skin, self._bodies.vertices(poses)]))

    def _of_barrier(self, x: Floats, ask: Callable[[Barrier, Floats], T]) -> T:
        vertices, _ = self._at(x)
        return self._core(lambda core: ask(core.barrier, vertices))

    def _add(self, out: Floats, skin: Floats, bodies: Floats) -> None:
        """Add forces on all vertices of the skin, (n, 3), and on the free bodies, (f, 6)."""
        positions(self._skin, out)[:] += skin[self._skin.owned_vertices]
        if self._comm.rank == 0:
            out[self._dofs] += bodies

    @override
    def energy(self, x: Floats) -> float:
        """Return the energy of barrier and friction in J.

        Friction has the normal forces of the last `lag_friction`. The energy is infinite where
        surfaces are too near to each other.
        """
        vertices, poses = self._at(x)
        return self._core(lambda core: core.energy(vertices, poses))

    @override
    def add_gradient(self, x: Floats, out: Floats) -> None:
        at = self._at(x)
        skin, bodies = self._core(lambda core: core.gradient(*at))
        self._add(out, skin, bodies)

    @override
    def entries(self, x: Floats, *, definite: bool) -> Floats:
        at = self._at(x)
        return self._core.alone(lambda core: core.entries(*at, definite=definite), NOTHING)

    @override
    def grow(self, x: Floats) -> None:
        at = self._at(x)
        if self._core(lambda core: core.grow(*at)):
            self.generation += 1
            self._take_pairs()

    @override
    def largest_step(self, x: Floats, step: Floats, factor: float, carried: Floats | None) -> float:
        begin, turn = self._vertices(x, self.poses_of(x)), self.motions(step)
        moved = np.zeros_like(self.poses) if carried is None else carried
        parts = positions(self._skin, step), turn[:, :3], moved[:, :3]
        farthest = max(float(np.abs(part).max(initial=0.0)) for part in parts)
        turned = float(np.linalg.norm(moved[:, 3:], axis=1).max(initial=0.0))
        turned = max(turned, self._bodies.largest_angle(turn))
        farthest, turned = (largest(self._comm, size) for size in (farthest, turned))
        factor = min(
            factor,
            FARTHEST * self._skin.pattern.size / max(farthest, 1e-300),
            LARGEST_TURN / max(turned, 1e-300),
        )
        free = 0.0
        while free < 1 and factor > 0:
            goal = x + factor * step
            end = self._vertices(goal, self._poses(goal, self.poses + factor * moved))
            free = self._free_part(begin, end)
            factor *= free
            if turned == 0:
                break
            # Where a body turns, a part of the step ends beside the straight way: look again.
            factor *= 1.0 if free == 1 else AGAIN
        return factor

    def _free_part(self, begin: Floats, end: Floats) -> float:
        return self._core(lambda core: core.barrier.largest_step(begin, end - begin))

    @override
    def refusal(self, x: Floats) -> str | None:
        return self._of_barrier(x, Barrier.refusal)

    @override
    def crossed(self, x: Floats) -> bool:
        return self._of_barrier(x, Barrier.crossed)

    @override
    def gap(self, x: Floats) -> float:
        return self._of_barrier(x, Barrier.gap)

    def count_pairs(self, x: Floats) -> int:
        """Return the number of pairs in contact."""
        return self._of_barrier(x, Barrier.count)

    def forces(self, x: Floats) -> Floats:
        """Return the gradient of the barrier in N at all vertices of skin and bodies, (v, 3)."""
        return self._of_barrier(x, Barrier.gradient)

    def normals(self, x: Floats) -> Floats:
        """Return the normal forces on the skin in N, (sides, n, 3), of half-spaces and bodies."""
        return self._of_barrier(x, Barrier.normals)

    @override
    def begin_step(self, sliding: Floats | None, load: Load) -> None:
        if self.friction is None:
            return
        if sliding is None:
            begin = np.zeros_like(self.poses) if load.poses is None else load.poses.copy()
            begin[self._bodies.free] = 0.0
            sliding = self.friction.at_rest(self.assembled, begin)
        self.friction.begin(sliding)
        self._core(lambda core: core.begin())

    @override
    def lag_friction(self, x: Floats) -> None:
        if self.friction is not None:
            at = self._at(x)
            self._core(lambda core: core.lag(*at))

    @override
    def end_step(self, x: Floats) -> Floats | None:
        if self.friction is None:
            return None
        at = self._at(x)
        return self._core(lambda core: core.end(*at))

    @override
    def coupling(self, x: Floats, change: Floats, *, transposed: bool = False) -> Floats:
        at, skin = self._at(x), self._skin.gather_vertices(positions(self._skin, change))
        turn = self._comm.bcast(self.motions(change), root=0)
        out = np.zeros_like(x)
        found = self._core(lambda core: core.coupling(*at, skin, turn, transposed=transposed))
        self._add(out, *found)
        return out


def _friction(contact: Contact, sizes: ContactSizes) -> SlidingFriction | None:
    """Return the friction on ground and bodies; None without, or without any of these."""
    if contact.friction is None or not contact.holds:
        return None
    grounds, bodies = len(contact.grounds), contact.bodies
    return SlidingFriction(contact.friction, sizes.slip, grounds, bodies, contact.pads)


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
