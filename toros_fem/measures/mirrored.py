"""Objective of a whole symmetric skin, as a function of the part that is simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats, Ints
from toros_fem.measures.shape import Nodes, Objective
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin


@dataclass(frozen=True, eq=False)
class ImageNodes:
    """Vertices of a whole skin, each on the rank that owns the vertex it is an image of.

    Attributes:
        pattern: The whole.
        comm: Communicator of the part.
        owned_vertices: Vertices of the whole on this rank.
    """

    pattern: Pattern
    comm: MPI.Comm
    owned_vertices: Ints


class MirroredObjective:
    """Objective T of the whole skin at the positions of a part and its mirror images.

    T is the same number as on the whole skin, to rounding. ∂T/∂x at a vertex of the part is the
    sum over its images, each mirrored back: all of them move together.

    Args:
        skin: The part, sewn.
        whole: Its completion by `meshes.mirrored`.
        objective: Makes the objective from the nodes of the whole. Arrays by vertex are in the
            order of `whole.pattern.points`.

    Attributes:
        objective: T, as it is evaluated on the whole.
    """

    def __init__(
        self, skin: Skin, whole: Mirrored, objective: Callable[[Nodes], Objective]
    ) -> None:
        place = np.full(len(skin.pattern.points), -1)
        place[skin.owned_vertices] = np.arange(len(skin.owned_vertices))
        node = place[whole.vertex]
        here = np.flatnonzero(node >= 0)
        self._node, self._signs = node[here], whole.signs[here]
        self.objective = objective(ImageNodes(whole.pattern, skin.comm, here))

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the part's owned nodes, (n, 3) (collective)."""
        return self.objective.forward(self._signs * positions[self._node])

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the part's owned nodes, (n, 3), in 1/m (collective)."""
        by_image = self._signs * self.objective.backward(self._signs * positions[self._node])
        count = len(positions)
        sums = [np.bincount(self._node, column, minlength=count) for column in by_image.T]
        return np.stack(sums, axis=1)
