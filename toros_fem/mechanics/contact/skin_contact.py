"""Contact as a term of a distributed skin: the first rank computes, all ranks get the results."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, override

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints, LocalInts
from toros_fem.base.mpi import OnFirst, largest, on_first_rank
from toros_fem.mechanics.contact.barrier import Barrier
from toros_fem.mechanics.contact.core import ContactCore
from toros_fem.mechanics.contact.free_bodies import FreeBodies
from toros_fem.mechanics.contact.opening import opened
from toros_fem.mechanics.contact.settings import Contact, ContactSizes
from toros_fem.mechanics.contact.sliding import SlidingFriction
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import Patch, Unknowns, blocks_of_first_rank, positions
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin

T = TypeVar("T")

# Largest motion of a step over the size of the skin: the space that longer ones sweep is full of
# pairs. Largest rotation of a body in rad: its vertices move straight in the search for pairs.
# Factor on a step that must be searched again.
FARTHEST, LARGEST_TURN, AGAIN = 0.1, 0.2, 0.9
# Entries of the tangent on all ranks but the first.
NOTHING: Floats = np.zeros(0)


class SkinContact(Term):
    """Energy, forces and tangent of a skin's contact with itself, bodies and half-spaces.

    Positions are gathered, and the first rank computes (`ContactCore`), so that results do not
    depend on the number of ranks. Middle surfaces stay a thickness apart: the surfaces of bodies
    and ground are moved inwards by half of it. All methods are collective; x are the owned unknowns
    of a state. Fixed components and symmetry planes are those of all vertices, (n, 3).

    Attributes:
        contact, sizes: As given.
        poses: Poses of all bodies, (k, 6), of those without unknowns as the load has them.
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
        self._bodies = bodies = FreeBodies(contact, sizes.thickness)
        self.poses: Floats = np.zeros((len(contact.bodies), 6))
        if bodies.count:
            blocks = blocks_of_first_rank(self._comm, bodies.count)
            self.unknowns = Unknowns(blocks, np.zeros((bodies.count, 6), dtype=bool))
        self.friction = friction = SlidingFriction(contact, sizes) if contact.holds else None
        pattern, prescribed = skin.pattern, np.asarray(fixed.all(axis=1))

        def make() -> ContactCore:
            sides = friction is not None
            barrier = Barrier(pattern, contact, sizes, prescribed, bodies, by_side=sides)
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

    def poses_of(self, x: Floats) -> Floats:
        """Return the poses of all bodies in a state, (k, 6), in m and rad."""
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

    def crossed(self, x: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""
        return self._of_barrier(x, Barrier.crossed)

    def gap(self, x: Floats) -> float:
        """Return the smallest distance of faces in m, at most that from which on contact acts."""
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

    @property
    def slides(self) -> bool:
        """Whether there is friction, by which the residual has no potential."""
        return self.friction is not None

    def begin_step(self, sliding: Floats | None, load: Load) -> None:
        """Begin a step of a path with friction; without friction nothing is done.

        It goes on from the end of the step before; None stands for a skin at rest at its assembled
        positions. The load is that of the step.
        """
        if self.friction is None:
            return
        if sliding is None:
            begin = np.zeros_like(self.poses) if load.poses is None else load.poses.copy()
            begin[self._bodies.free] = 0.0
            sliding = self.friction.at_rest(self.assembled, begin)
        self.friction.begin(sliding)
        self._core(lambda core: core.begin())

    def lag_friction(self, x: Floats) -> None:
        """Let friction have the normal forces and tangent planes of a state."""
        if self.friction is not None:
            at = self._at(x)
            self._core(lambda core: core.lag(*at))

    def end_step(self, x: Floats) -> Floats | None:
        """Return where the vertices stick at the end of a step; None without friction."""
        if self.friction is None:
            return None
        at = self._at(x)
        return self._core(lambda core: core.end(*at))

    def coupling(self, x: Floats, change: Floats, *, transposed: bool = False) -> Floats:
        """Return the change of friction by that of the normal forces: the part without symmetry.

        x is the state of the last `lag_friction`, and `change` that of the state; `transposed`
        multiplies by the transpose.
        """
        at, skin = self._at(x), self._skin.gather_vertices(positions(self._skin, change))
        turn = self._comm.bcast(self.motions(change), root=0)
        out = np.zeros_like(x)
        found = self._core(lambda core: core.coupling(*at, skin, turn, transposed=transposed))
        self._add(out, *found)
        return out
