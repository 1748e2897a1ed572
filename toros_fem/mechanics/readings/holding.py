"""Force by which a skin pushes rigid bodies, as a term of an objective."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import gather_by_index, on_first_rank
from toros_fem.base.validation import checked_floats, require_between, require_positive
from toros_fem.measures.shape import Nodes, require_nodes
from toros_fem.mechanics.contact.barrier import Barrier
from toros_fem.mechanics.contact.free_bodies import FreeBodies
from toros_fem.mechanics.contact.neighbours import collision_filter
from toros_fem.mechanics.contact.settings import Contact, ContactSizes


class HoldingObjective:
    """T = ½ w max(0, 1 − a · F / F₀)², F the sum of the normal forces of the skin on the bodies.

    The direction a need not be of length 1: with friction μ a body that moves down is held by
    F_up + μ F_across. Where nothing touches, T does not depend on the skin: another term must bring
    it to the bodies.

    Args:
        skin: The sewn skin.
        contact: The contact; its bodies are where they were made.
        sizes: Its sizes.
        fixed: Fixed components of all vertices, (n, 3), as of `Supports`.
        direction: a, (3,).
        force: F₀ in N.
        factor: w.

    Raises:
        ParameterError: There is no body, or a value is out of bounds.
        MissingPackageError: ipctk is not installed.
    """

    def __init__(
        self,
        skin: Nodes,
        contact: Contact,
        sizes: ContactSizes,
        fixed: Bools,
        direction: Sequence[float] | Floats,
        force: float,
        factor: float = 1.0,
    ) -> None:
        require_nodes(skin)
        require_between(0.0, np.inf, factor=factor)
        require_positive(force=force)
        along = checked_floats("direction", direction, "a finite vector of three", (3,))
        if not contact.bodies:
            raise ParameterError("this contact has no bodies that a skin could hold.")
        self._skin, self._count = skin, len(skin.pattern.points)
        self._force, self._factor = force, factor
        self._bodies = np.concatenate([b.inset(sizes.thickness / 2) for b in contact.bodies])
        self._motion = np.zeros((self._count + len(self._bodies), 3))
        self._motion[self._count :] = along
        self._barrier: Barrier | None = None

        def make() -> None:
            self._barrier = self._made(contact, sizes, np.asarray(fixed))

        on_first_rank(skin.comm, make)

    def _made(self, contact: Contact, sizes: ContactSizes, fixed: Bools) -> Barrier:
        """Return the barrier between skin and bodies (one rank)."""
        pattern, bodies = self._skin.pattern, FreeBodies(contact, sizes.thickness)
        return Barrier(
            self._all(pattern.points),
            np.concatenate([pattern.triangles, bodies.triangles + self._count]),
            np.concatenate([pattern.areas, bodies.areas]),
            (),
            np.zeros(0, dtype=np.int64),
            sizes,
            collision_filter(
                pattern,
                sizes,
                prescribed=np.asarray(fixed.all(axis=1)),
                bodies=bodies.counts,
                self_contact=False,
            ),
        )

    def force(self, positions: Floats) -> float:
        """Return a · F in N at positions of the owned nodes, (n, 3) (collective)."""
        return self._at(positions)[0]

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        return 0.5 * self._factor * self._missing(self.force(positions)) ** 2

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        force, slope = self._at(positions)
        price = -self._factor * self._missing(force) / self._force
        return np.asarray(price * slope[self._skin.owned_vertices])

    def _missing(self, force: float) -> float:
        return max(0.0, 1 - force / self._force)

    def _at(self, positions: Floats) -> tuple[float, Floats]:
        """Return a · F in N, and its derivative by all vertices of the skin in N/m, (n, 3)."""
        skin = self._skin
        whole = gather_by_index(skin.comm, skin.owned_vertices, positions, self._count)

        def evaluated() -> tuple[float, Floats]:
            assert self._barrier is not None
            x = self._all(whole)
            # The bodies' part of the energy's gradient is minus the force on them.
            force = -float((self._motion * self._barrier.gradient(x)).sum())
            slope = -(self._barrier.hessian(x) @ self._motion.ravel()).reshape(-1, 3)
            return force, slope[: self._count]

        return on_first_rank(skin.comm, evaluated)

    def _all(self, skin: Floats) -> Floats:
        return np.asfortranarray(np.concatenate([skin, self._bodies]))
