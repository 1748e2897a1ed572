"""Objectives behind a motion: of the skin fitted to the target, and of a whole that is mirrored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem.base.mpi import sum_over_ranks
from toros_fem.base.validation import Floats, Ints
from toros_fem.measures.rotation import polar_rotation, require_determined
from toros_fem.measures.shape import (
    Nodes,
    Objective,
    checked_target,
    require_objective,
    weighted_areas,
)
from toros_fem.meshes.pattern import Mirrored, Pattern
from toros_fem.meshes.skin import Skin


class AlignedObjective:
    """Objective of the skin after a rigid motion onto the target: T(R(x − x̄) + x̄*).

    R and the means minimise the sum of squares (Kabsch 1976), in which each vertex counts by its
    flat area, times its weight, (n,). Their dependence on x is part of the gradient, so that T may
    be any objective. A skin or target on a line, whose best rotation is not unique, is a
    ParameterError on use.

    Attributes:
        objective: T, as it is evaluated after the motion.
    """

    def __init__(
        self, skin: Nodes, target: Floats, objective: Objective, weights: Floats | None = None
    ) -> None:
        target = checked_target(skin, target)
        require_objective("objective", objective)
        weight = weighted_areas(skin, "weights", weights, 1.0)[:, 0]
        weight, owned = weight / weight.sum(), skin.owned_vertices
        self._comm, self.objective = skin.comm, objective
        self._centre = weight @ target
        self._target = target[owned] - self._centre
        self._weight = weight[owned, None]

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        return self.objective.forward(self.aligned(positions))

    def aligned(self, positions: Floats) -> Floats:
        """Return the positions moved rigidly onto the target, (n, 3) (collective)."""
        arm, rotation, _ = self._fit(positions)
        return np.asarray(arm @ rotation.T + self._centre)

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        arm, rotation, matrix = self._fit(positions)
        aligned = arm @ rotation.T + self._centre
        by_arm = self.objective.backward(aligned) @ rotation
        torque = sum_over_ranks(self._comm, np.cross(arm, by_arm).sum(axis=0))
        reach = np.linalg.solve(matrix, torque)
        by_arm += self._weight * np.cross(self._target @ rotation, reach)
        return np.asarray(by_arm - self._weight * sum_over_ranks(self._comm, by_arm.sum(axis=0)))

    def _fit(self, positions: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the arms from the mean, (n, 3), the rotation, and B of `polar_rotation`."""
        mean = sum_over_ranks(self._comm, (self._weight * positions).sum(axis=0))
        arm = positions - mean
        moment = sum_over_ranks(self._comm, (self._weight * self._target).T @ arm)
        rotation, matrix = polar_rotation(moment)
        require_determined(matrix[None], ["the skin"], "Do not align.")
        return arm, rotation, matrix


@dataclass(frozen=True, eq=False)
class ImageNodes:
    """Vertices of a whole skin, each on the rank that owns the vertex it is an image of."""

    pattern: Pattern
    comm: MPI.Comm
    owned_vertices: Ints


class MirroredObjective:
    """Objective T of the whole skin at the positions of a part and its mirror images.

    T is the same number as on the whole skin, to rounding. ∂T/∂x at a vertex of the part is the sum
    over its images, each mirrored back: all of them move together. `objective` makes T from the
    nodes of the whole; arrays by vertex are in the order of `whole.pattern.points`.

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
