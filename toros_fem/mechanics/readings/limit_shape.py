"""Shape of a skin on ever finer meshes, from two elements on one mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import dihedral_angles, edges_of

# Error with smoothed strains over what smoothing has changed (docs/theory/error.md).
GAIN = 1.4
# Parts of the half-width of an interval: of the correction; of the change from rest; and of that
# times the mean square of the angles at edges, by which a skin of triangles is no round one.
SHARE, FLOOR, ROUND = 0.4, 0.012, 1.0
# Edges that are folded by more are creases of the skin itself, in rad.
CREASE = np.radians(45.0)


@dataclass(frozen=True, eq=False)
class LimitShape:
    """A shape on its mesh, and where it tends to on finer ones.

    Measures are functions of a pattern and the positions of its vertices that return a number, or
    several.

    Attributes:
        pattern: The mesh.
        computed: Positions of all vertices in equilibrium, (n, 3), in m.
        limit: Those that are told.
    """

    pattern: Pattern
    computed: Floats
    limit: Floats

    def half_width(self, measure: Callable[[Pattern, Floats], Any]) -> float:
        """Return the half-width of the interval of a measure, of several numbers as a distance.

        A distance may be least at the limit: what changes on its other side counts too.
        """
        told = measure(self.pattern, self.limit)

        def away(positions: Floats) -> float:
            return float(np.linalg.norm(np.subtract(measure(self.pattern, positions), told)))

        corrected = max(away(self.computed), away(2 * self.limit - self.computed))
        return SHARE * corrected + self._coarseness * away(self.pattern.points)

    @cached_property
    def _coarseness(self) -> float:
        pattern = self.pattern
        edges = edges_of(pattern.triangles)
        angles = dihedral_angles(self.limit, pattern.triangles, edges)
        return FLOOR + ROUND * float(np.mean(angles[np.abs(angles) < CREASE] ** 2))


def limit_shape(solver: EquilibriumSolver, at: Equilibrium) -> LimitShape:
    """Return the limit of an equilibrium of a solver with smoothed strains (collective).

    Triangles of constant strain lock where print bends in its plane, smoothed ones by half as much,
    and the ratio of the errors hardly depends on the mesh. One Newton step tells how far the shape
    without smoothing is away; the limit lies `GAIN` times as far on the other side. This is
    Richardson's extrapolation with two elements in place of two meshes.

    Without smoothed strains, and of a trial, the limit is the shape itself.
    """
    known = _KNOWN.get(at)
    if known is None:
        skin, model = solver.skin, solver.model
        computed = skin.gather_vertices(at.positions)
        limit = computed
        if model.composite.membrane.smoothed and at.complete:
            step = model.positions(solver.unsmoothed_step(at))
            limit = computed - GAIN * skin.gather_vertices(step)
        known = _KNOWN[at] = LimitShape(skin.pattern, computed, np.asarray(limit))
    return known


# Shapes are read again and again: by each metric, by frames and pictures.
_KNOWN: WeakKeyDictionary[Equilibrium, LimitShape] = WeakKeyDictionary()
