"""Sheets that the cases of bending bend: meshes, forces, and quantities read off."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from benchmarks.accuracy.scenes import COMM
from toros_fem.materials.sheet import Bending, Composite, Material
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Pattern, Skin, rectangle, sew
from toros_fem.meshes.sheets import one_panel

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Far beyond any strain here, near enough not to cost digits: eq. (1) is then linear elasticity.
FAR = 1.5


def elastic(
    young: float, poisson: float, thickness: float, curvature: str, rest: str = "flat"
) -> Composite:
    """A linear elastic sheet."""
    sheet = Material(young, poisson, thickness)
    return Composite(sheet, sheet, c1=FAR, c2=FAR, bending=Bending(curvature, rest=rest))


def warped(pattern: Pattern, warp: Callable[[Floats], Floats]) -> Pattern:
    """The same triangles on another flat shape."""
    return one_panel(warp(pattern.flat_points), pattern.flat_triangles)


def jittered(n: int) -> Pattern:
    """A unit square of right triangles whose inner vertices are moved at random, by n × n."""
    plain = rectangle(COMM, 1.0, 1.0, 1 / n, "right")
    flat = plain.flat_points
    inside = ((flat > 1e-9) & (flat < 1 - 1e-9)).all(axis=1)
    moves = np.random.default_rng(0).uniform(-0.2 / n, 0.2 / n, flat.shape)
    return one_panel(flat + moves * inside[:, None], plain.flat_triangles)


def line_force(pattern: Pattern, on: Mask, per_length: Floats) -> Floats:
    """Nodal forces (n, 3) of a force per flat length on the free edges between some vertices."""
    force = np.zeros((len(pattern.points), 3))
    edges = pattern.free_edges
    edges = edges[on[edges].all(axis=1)]
    flat = np.zeros((len(pattern.points), 2))
    flat[pattern.sewn] = pattern.flat_points
    length = np.linalg.norm(flat[edges[:, 1]] - flat[edges[:, 0]], axis=1)
    for end in edges.T:
        np.add.at(force, end, 0.5 * length[:, None] * per_length)
    return force


def value_at(pattern: Pattern, values: Floats, place: Floats) -> float:
    """A smooth nodal field at a flat place: the quadratic through the vertices around it."""
    flat = pattern.flat_points
    near = np.argsort(np.linalg.norm(flat - place, axis=1))[:12]
    x, y = (flat[near] - place).T
    columns = np.column_stack([np.ones(len(near)), x, y, x * x, x * y, y * y])
    return float(np.linalg.lstsq(columns, values[pattern.sewn[near]], rcond=None)[0][0])


class Sheet:
    """A sheet in its supports, and its last equilibrium.

    Args:
        pattern: The sheet.
        composite: Its material.
        supports: What is held.
    """

    def __init__(self, pattern: Pattern, composite: Composite, supports: Supports) -> None:
        self.pattern = pattern
        self.skin: Skin = sew(COMM, pattern)
        self.solver = EquilibriumSolver(
            self.skin, composite, supports, NewtonOptions(max_steps=200)
        )
        self._fabric = np.zeros(len(self.skin.owned_cells))
        self._last: Equilibrium | None = None

    def bend(self, force: Floats | None, start: Floats | None = None) -> Equilibrium:
        """The equilibrium under dead forces, from the last one or a given start."""
        if start is None and self._last is not None:
            start = self._last.state
        self._last = self.solver.solve(self._fabric, Load(0.0, force=force), start=start)
        return self._last

    def positions(self) -> Floats:
        """All vertices' positions in the last equilibrium, (n, 3)."""
        assert self._last is not None
        return self.skin.gather_vertices(self._last.positions)
