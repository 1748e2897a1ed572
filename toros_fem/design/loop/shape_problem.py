"""The design problem of an inflated skin, and derivatives of what is measured of its shape."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.triangles import gradients

# Largest displacement in differences of metrics, over the size of the skin.
METRIC_STEP = 1e-5
# Largest move of a flat point in differences of forces, over the size of the least triangle.
FLAT_STEP = 1e-3
# Volume of a flat skin at rest, at most, over its area to the power of 3/2: layers lie apart by
# about a thickness, which makes 0.003; long tubes have 0.01.
FLAT = 0.005
TINY = float(np.finfo(float).tiny)


@dataclass(eq=False)
class ShapeProblem(DesignProblem[Equilibrium]):
    """A skin under pressure, designed towards the shape that it shall take, eqs. (17-19)."""

    physics: InflatedSkin

    @property
    def solver(self) -> EquilibriumSolver:
        """Equilibrium solver of the skin."""
        return self.physics.solver

    @property
    def flat_at_rest(self) -> bool:
        """Whether a closed skin encloses nothing at rest, as two layers do (collective)."""
        model, area = self.solver.model, float(self.skin.pattern.areas.sum())
        if model.pressure is None:
            return False
        return float(np.abs(model.volumes(model.assembled)).sum()) < FLAT * area**1.5

    def metrics_at(self, owned: Floats) -> dict[str, float]:
        """Return the values of all metrics for positions of the owned nodes (collective)."""
        if not self.metrics:
            return {}
        positions, pattern = self.skin.gather_vertices(owned), self.skin.pattern
        return {m.key: m.value(pattern, positions) for m in self.metrics}

    def shape_derivatives(
        self,
        evaluation: Evaluation[Equilibrium],
        moves: Sequence[Floats],
        values: Callable[[Floats], Floats],
    ) -> Floats:
        """Return the derivatives of values along moves of the flat points, (j, m) (collective).

        K y = −(∂f/∂X) δX with the last tangent gives the motion y of the vertices. Points of the
        material, by which shapes are compared, move by y − F δX. Forces are differenced in the flat
        points, values along the motion.

        Args:
            evaluation: A simulation of this problem.
            moves: δX of the pattern's flat points, (k, 2), in m, one array for each of m
                derivatives. Both sides of a seam move alike.
            values: Function of the positions of all vertices, (n, 3), in m, that returns j numbers.
        """
        at, skin, model = evaluation.equilibrium, self.skin, self.solver.model
        pattern, places = skin.pattern, skin.mesh.geometry.x
        self.solver.tangent_at(at)
        here, rest, flat = skin.gather_vertices(at.positions), places.copy(), _flat_points(skin)
        least = FLAT_STEP * float(np.sqrt(pattern.areas.min()))

        def put(way: Floats | None) -> None:
            places[:] = rest
            if way is not None:
                places[: len(flat), :2] += way[flat]
            for term in model.terms:
                term.after_move()

        def force(way: Floats) -> Floats:
            put(way)
            return np.array(model.residual(at.state))

        steps = [least / max(float(np.abs(move).max()), TINY) for move in moves]
        try:
            pushes = [
                np.asarray((force(-step * move) - force(step * move)) / (2 * step))
                for step, move in zip(steps, moves, strict=True)
            ]
        finally:
            put(None)
        columns = []
        for push, move in zip(pushes, moves, strict=True):
            motion = skin.gather_vertices(model.positions(self.solver.solve_tangent(push, at)))
            motion = motion - carried_along(pattern, here, move)
            step = METRIC_STEP * pattern.size / max(float(np.abs(motion).max()), TINY)
            ends = (values(here + sign * step * motion) for sign in (1, -1))
            columns.append(np.subtract(*ends) / (2 * step))
        return np.stack(columns, axis=1)


def _flat_points(skin: Skin) -> Ints:
    """Return the pattern's flat point at each corner of this rank's triangles, (3 c,)."""
    cell = skin.cell[skin.density_space.dofmap.list.ravel()]
    vertex = skin.vertex[skin.position_space.dofmap.list]
    there = skin.pattern.triangles[cell]
    corner = np.argmax(there[:, None, :] == vertex[:, :, None], axis=2)
    points: Ints = np.take_along_axis(skin.pattern.flat_triangles[cell], corner, axis=1).ravel()
    return points


def carried_along(pattern: Pattern, positions: Floats, motion: Floats) -> Floats:
    """Return F δX at the vertices, (n, 3): their way if flat points move with the material.

    F is the mean over the triangles around a vertex, by area. Positions are those of all vertices,
    (n, 3), the motion is δX of the flat points, (k, 2), in m.
    """
    corners = positions[pattern.triangles]
    gradient = np.einsum("tci,tcj->tij", corners, gradients(pattern.corners))
    each = np.einsum("tij,tcj->tci", gradient, motion[pattern.flat_triangles])
    weight, vertex = np.repeat(pattern.areas, 3), pattern.triangles.ravel()
    size = len(pattern.points)
    total = np.bincount(vertex, weight, size)
    rows = (np.bincount(vertex, weight * way, size) for way in each.reshape(-1, 3).T)
    return np.stack([row / total for row in rows], axis=1)
