"""Force by which a skin pushes rigid bodies, as a term of an objective."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import OnFirst, gather_by_index
from toros_fem.base.validation import (
    Bools,
    Floats,
    checked_floats,
    require_between,
    require_positive,
)
from toros_fem.measures.shape import Nodes, require_nodes
from toros_fem.mechanics.contact.barrier import Barrier
from toros_fem.mechanics.contact.bodies import FreeBodies
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.layers import ContactSizes


class HoldingObjective:
    """T = ½ w max(0, 1 − a · F / F₀)², F the sum of the normal forces of the skin on the bodies.

    The direction a need not be of length 1: with friction μ a body that moves down is held by F_up
    + μ F_across. Where nothing touches, T does not depend on the skin: another term must bring it
    to the bodies. These are where they were made.

    Args:
        skin: The sewn skin.
        contact, sizes: What touches, and its numbers.
        fixed: Fixed components of all vertices, (n, 3), as of `Supports`.
        direction: a, (3,).
        force: F₀ in N.
        factor: w.
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
        self._skin, self._along, self._bodies = skin, along, contact.bodies
        self._force, self._factor = force, factor
        pattern, prescribed = skin.pattern, np.asarray(fixed.all(axis=1))
        touched = replace(contact, ground=None, pads=None, self_contact=False)
        bodies = FreeBodies(touched.bodies, sizes.thickness)
        self._places = bodies.vertices(np.zeros((len(touched.bodies), 6)))
        self._barrier = OnFirst(
            skin.comm,
            lambda: Barrier(
                pattern, (), bodies, sizes, prescribed, self_contact=False, by_side=True
            ),
        )

    def force(self, positions: Floats) -> float:
        """Return a · F in N at positions of the owned nodes, (n, 3) (collective)."""
        x = self._vertices(positions)
        pushes = self._barrier(lambda barrier: barrier.normals(x))
        return -float((pushes @ self._along).sum())

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        return 0.5 * self._factor * self._missing(self.force(positions)) ** 2

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        x, force = self._vertices(positions), self.force(positions)
        price = -self._factor * self._missing(force) / self._force
        sides, count = len(self._bodies), len(self._skin.pattern.points)
        weights = np.broadcast_to(-price * self._along, (sides, count, 3))
        slope = self._barrier(lambda barrier: barrier.normals_backward(x, weights))
        return np.asarray(slope[self._skin.owned_vertices])

    def _missing(self, force: float) -> float:
        return max(0.0, 1 - force / self._force)

    def _vertices(self, positions: Floats) -> Floats:
        skin = self._skin
        count = len(skin.pattern.points)
        whole = gather_by_index(skin.comm, skin.owned_vertices, positions, count)
        return np.asfortranarray(np.concatenate([whole, self._places]))
