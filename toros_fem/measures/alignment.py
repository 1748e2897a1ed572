"""Objectives that do not depend on rigid motion."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import sum_over_ranks
from toros_fem.measures.rotation import polar_rotation, require_determined
from toros_fem.measures.shape import (
    Nodes,
    Objective,
    checked_target,
    require_objective,
    weighted_areas,
)


class AlignedObjective:
    """Objective of the skin after a rigid motion onto the target: T(R(x − x̄) + x̄*).

    R and the means minimise the sum of squares (Kabsch 1976), in which each vertex counts by its
    flat area. Their dependence on x is part of the gradient, so that T may be any objective.

    Args:
        skin: The sewn skin.
        target: Target positions of all assembled vertices, (n, 3), in m.
        objective: T, evaluated after the motion.
        weights: Factor on each vertex's area in the fit, (n,); None: 1.

    Attributes:
        objective: T, as it is evaluated after the motion.

    Raises:
        TargetError: On use, if the skin or the target lies on a line, so that the best rotation is
            not unique.
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
