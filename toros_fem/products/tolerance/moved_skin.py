"""A skin whose print is wider or narrower, and where the shape before the move goes with it."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.shape_problem import carried_along
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tolerance.result import OBJECTIVE


class MovedSkin:
    """The same skin with its print's borders moved (all methods are collective).

    Attributes:
        problem: Its design problem.
        unknowns: Where the equilibrium's unknowns go with the mesh, by original index.

    Args:
        problem: The problem on the moved pattern.
        nominal: The pattern before.
        motion: Way of the flat points, (m, 2), in m.
        unknowns: Unknowns of the equilibrium before, as of `Patch.gather`.
    """

    def __init__(
        self, problem: ShapeDesign, nominal: Pattern, motion: Floats, unknowns: Floats
    ) -> None:
        self.problem, self._nominal, self._motion = problem, nominal, motion
        count = 3 * len(nominal.points)
        places = unknowns[:count].reshape(-1, 3)
        moved = places + self._carried(nominal, places)
        self.unknowns = np.concatenate([moved.ravel(), unknowns[count:]])

    def state(self) -> Floats:
        """Return the state of this rank."""
        return self.problem.solver.model.patch.scatter(self.unknowns)

    def before(self, owned: Floats) -> Floats:
        """Return where all vertices' places before the move are in a shape, (n, 3), in m.

        Metrics and objectives sort vertices by their places; so these stay the same ones. Ranks may
        own others than those of the skin before the move.
        """
        skin = self.problem.skin
        positions = skin.gather_vertices(owned)
        return np.asarray(positions - self._carried(skin.pattern, positions))

    def _carried(self, pattern: Pattern, positions: Floats) -> Floats:
        """Return the way of all vertices with the deformed mesh, (n, 3)."""
        way = carried_along(pattern, positions, self._motion)
        # What is held stays where the supports have it.
        held = self.problem.skin.pattern.points - self._nominal.points
        fixed = self.problem.solver.model.supports.fixed
        return np.where(fixed, held, way)


def values_at(problem: ShapeDesign, owned: Floats) -> dict[str, float]:
    """Return objective and metrics at positions of the owned nodes, by key (collective)."""
    return {OBJECTIVE: problem.objective.forward(owned), **problem.metrics_at(owned)}
