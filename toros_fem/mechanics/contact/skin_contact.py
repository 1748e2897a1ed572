"""Contact as a term of a distributed skin: the first rank computes, all ranks get the results."""

from __future__ import annotations

from typing import Any, override

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints, LocalInts
from toros_fem.base.mpi import largest, on_first_rank, total
from toros_fem.mechanics.contact.core import ContactCore
from toros_fem.mechanics.contact.free_bodies import FreeBodies
from toros_fem.mechanics.contact.opening import opened
from toros_fem.mechanics.contact.settings import Contact, ContactSizes
from toros_fem.mechanics.contact.sliding import Sliding, SlidingFriction
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import Patch, Unknowns, blocks_of_first_rank, positions
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin

# Way of a free body over the size of the skin at which it is taken to fall without end.
FALLEN = 3.0
# Largest motion of a step over the size of the skin: the space that longer ones sweep is full of
# pairs. Largest rotation of a body in rad: its vertices move straight in the search for pairs.
# Factor on a step that must be searched again.
FARTHEST, LARGEST_TURN, AGAIN = 0.1, 0.2, 0.9


class SkinContact(Term):
    """Energy, forces and tangent of a skin's contact with itself, bodies and half-spaces.

    Positions are gathered, and the first rank computes (`ContactCore`), so that results do not
    depend on the number of ranks. Middle surfaces stay a thickness apart: the surfaces of bodies
    and ground are moved inwards by half of it. All methods are collective; x are the owned unknowns
    of a state.

    Attributes:
        contact, sizes: As given.
        poses: Poses of all bodies, (k, 6), of those without unknowns as the load has them.
        friction: Friction of the skin on ground and bodies; None without.
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
        self.poses: Floats = np.zeros((len(contact.bodies), 6))
        self._weight_fraction = 0.0
        if self._bodies.count:
            blocks = blocks_of_first_rank(self._comm, self._bodies.count)
            self.unknowns = Unknowns(blocks, np.zeros((self._bodies.count, 6), dtype=bool))
        self.friction: SlidingFriction | None = None
        if contact.holds:
            self.friction = SlidingFriction(contact, sizes)
        self._core: ContactCore | None = None

        def make() -> None:
            prescribed = np.asarray(fixed.all(axis=1))
            self._core = ContactCore(
                skin.pattern, contact, sizes, prescribed, self._bodies, self.friction
            )

        on_first_rank(self._comm, make)
        self.assembled: Floats = skin.pattern.points
        if contact.self_contact:
            self.assembled = on_first_rank(
                self._comm, lambda: opened(skin.pattern, sizes, in_planes)
            )

    def _first(self, method: str, *args: Any, **named: Any) -> Any:
        """Return on all ranks what a method of the core returns; its errors reach all."""
        return on_first_rank(self._comm, lambda: getattr(self._core, method)(*args, **named))

    def _first_alone(self, method: str, *args: Any, **named: Any) -> Floats:
        """Return numbers of the core on the first rank, and none on the others."""
        kept = [np.zeros(0)]
        on_first_rank(self._comm, lambda: kept.append(getattr(self._core, method)(*args, **named)))
        return kept[-1]

    @override
    def number(self, patch: Patch, dofs: LocalInts) -> None:
        index_map = patch.space.dofmap.index_map
        self._dofs = dofs.reshape(-1, 6)
        whole = self._skin.gather_vertices(patch.numbers.astype(np.float64)).astype(np.int64)
        whole[self._fixed] = -1
        numbers: Ints = np.append(whole.ravel(), index_map.local_to_global(dofs.ravel()))
        self._first("number", numbers, index_map.size_global)
        self._take_pairs()

    def _take_pairs(self) -> None:
        if self._core is not None:
            self.pairs = self._core.pairs

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

    def poses_of(self, x: Floats) -> Floats:
        """Return the poses of all bodies in a state, (k, 6), in m and rad."""
        return self._bodies.poses(self._comm.bcast(self.motions(x), root=0), self.poses)

    def _at(self, x: Floats) -> tuple[Floats, Floats]:
        """Return all vertices of skin and bodies on every rank, and the poses."""
        skin, poses = self._skin.gather_vertices(positions(self._skin, x)), self.poses_of(x)
        everything = np.concatenate([skin, self._bodies.vertices(poses)])
        return np.asfortranarray(everything), poses

    def _vertices(self, x: Floats) -> Floats:
        return self._at(x)[0]

    def _add(self, out: Floats, skin: Floats, bodies: Floats) -> None:
        """Add forces on all vertices of the skin, (n, 3), and on the free bodies, (f, 6)."""
        positions(self._skin, out)[:] += skin[self._skin.owned_vertices]
        if self._comm.rank == 0:
            out[self._dofs] += bodies

    @override
    def energy(self, x: Floats) -> float:
        """Return barrier energy less the work of the bodies' weight, in J, and with friction.

        Friction has the normal forces of the last `lag_friction`. The energy is infinite where
        surfaces are too near to each other.
        """
        every, poses = self._at(x)
        found: float = self._first("energy", every, poses)
        return found - self._weight_fraction * self._bodies.work(poses)

    @property
    def _weight(self) -> Floats:
        """Force of gravity on the unknowns of the free bodies that acts, in N, (f, 6)."""
        return self._weight_fraction * self._bodies.weight

    @override
    def add_gradient(self, x: Floats, out: Floats) -> None:
        skin, bodies = self._first("gradient", *self._at(x))
        self._add(out, skin, bodies - self._weight)

    @override
    def entries(self, x: Floats, *, definite: bool) -> Floats:
        return self._first_alone("entries", *self._at(x), definite=definite)

    def convexity_gap(self, x: Floats) -> Floats | None:
        """Return the semidefinite `entries` less the exact ones; None if nothing touches."""
        at = self._at(x)
        return self._first_alone("convexity_gap", *at) if self.count_pairs() else None

    @override
    def grow(self, x: Floats) -> None:
        if self._first("grow", *self._at(x)):
            self.generation += 1
            self._take_pairs()

    @override
    def add_applied(self, x: Floats, out: Floats) -> None:
        if self._comm.rank == 0:
            out[self._dofs] += self._weight

    @override
    def load_energy(self, x: Floats) -> float:
        return total(self._comm, float(np.abs(self._weight * self.motions(x)).sum()))

    @override
    def largest_step(self, x: Floats, step: Floats, factor: float, carried: Floats | None) -> float:
        """Return a factor on a step, at most the given one, so that nothing meets on the way."""
        every = self._vertices(x)
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
            free = self._first("free_part", every, self._vertices(x + factor * step))
            factor *= free
            if turned == 0:
                break
            # Where a body turns, a part of the step ends beside the straight way: look again.
            factor *= 1.0 if free == 1 else AGAIN
        self.poses[:] = poses
        return factor

    @override
    def refusal(self, x: Floats) -> str | None:
        bodies = zip(self.contact.bodies, self._bodies.counts, strict=True)
        names = [body.name for body, count in bodies for _ in range(count)]
        found: str | None = self._first("refusal", self._vertices(x), names)
        return found

    def crossed(self, x: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""
        return bool(self._first("crossed", self._vertices(x)))

    def gap(self, x: Floats) -> float:
        """Return the smallest distance of faces in m, at most that from which on contact acts."""
        return float(self._first("gap", self._vertices(x)))

    def count_pairs(self) -> int:
        """Return the number of pairs in contact at the last state."""
        return int(self._first("count_pairs"))

    def forces(self, x: Floats) -> Floats:
        """Return the gradient of the barrier in N at all vertices of skin and bodies, (v, 3)."""
        return np.asarray(self._first("forces", self._vertices(x)))

    def normals(self, x: Floats) -> Floats:
        """Return the normal forces on the skin in N, (sides, n, 3), of half-spaces and bodies."""
        return np.asarray(self._first("normals", self._vertices(x)))

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
        if sliding is None:
            begin = np.zeros_like(self.poses) if load.poses is None else load.poses.copy()
            begin[self._bodies.free] = 0.0
            sliding = self.friction.at_rest(self.assembled, begin)
        self.friction.begin(sliding)
        self._first("begin")

    def lag_friction(self, x: Floats) -> None:
        """Let friction have the normal forces and tangent planes of a state."""
        if self.friction is not None:
            self._first("lag", *self._at(x))

    def end_step(self, x: Floats) -> Sliding | None:
        """Return where the vertices stick at the end of a step; None without friction."""
        if self.friction is None:
            return None
        self.lag_friction(x)
        every, poses = self._at(x)
        friction, skin = self.friction, every[: len(self._skin.pattern.points)]
        return on_first_rank(self._comm, lambda: friction.end(skin, poses))

    def coupling(self, x: Floats, change: Floats, *, transposed: bool = False) -> Floats:
        """Return the change of friction by that of the normal forces: the part without symmetry.

        Args:
            x: State of the last `lag_friction`.
            change: Change of the state.
            transposed: Whether to multiply by the transpose.
        """
        skin = self._skin.gather_vertices(positions(self._skin, change))
        turn = self._comm.bcast(self.motions(change), root=0)
        out = np.zeros_like(x)
        found = self._first("coupling", *self._at(x), skin, turn, transposed=transposed)
        self._add(out, *found)
        return out

    def begin_step_backward(self, x: Floats, adjoint: Floats) -> Floats:
        """Return Σ adjoint · d(force)/d(anchors at the begin), (sides, n, 3), on all ranks.

        Args:
            x: State of the last `lag_friction`.
            adjoint: Owned unknowns.
        """
        whole = self._skin.gather_vertices(positions(self._skin, adjoint))
        return np.asarray(self._first("begin_backward", *self._at(x), whole))

    def end_step_backward(self, x: Floats, slope: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives of Σ slope · anchors at the end, by state and by the begin.

        Args:
            x: State of the last `lag_friction`.
            slope: Numbers for each anchor, (sides, n, 3), equal on all ranks.
        """
        skin, by_anchor = self._first("end_backward", *self._at(x), slope)
        out = np.zeros_like(x)
        positions(self._skin, out)[:] = skin[self._skin.owned_vertices]
        return out, by_anchor
