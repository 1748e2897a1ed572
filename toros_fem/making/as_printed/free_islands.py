"""Designs that go on without the free islands of their print, or with islands joined to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.loop.fields import densities_of
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.making.as_printed.as_printed import PrintedDesign

# Returns which of some points are meant, of the free islands of a panel, the largest first, and of
# the print beside all of them.
Choice = Callable[[np.ndarray, Sequence[BaseGeometry], BaseGeometry], Bools]


def remove_islands(problem: DesignProblem, result: DesignResult, printed: PrintedDesign) -> Floats:
    """Return ρ at owned triangles without the free islands of its contours (collective).

    An island may carry load: `connect_islands` keeps it. Where a part of the skin is designed, its
    triangles and panels are the first of the whole, at the same flat places.
    """
    radius = densities_of(problem.fields).filter.radius

    def cleared(at: np.ndarray, islands: Sequence[BaseGeometry], rest: BaseGeometry) -> Bools:
        # Densities up to R beyond its border contribute to an island. Those closer than R/2 to
        # the rest of the print contribute to the rest as well and stay.
        near = shapely.dwithin(at, shapely.union_all(islands), radius)
        return near & ~shapely.dwithin(at, rest, radius / 2)

    return np.where(_chosen(problem, printed, cleared), 0.0, result.density)


def connect_islands(problem: DesignProblem, result: DesignResult, printed: PrintedDesign) -> Floats:
    """Return ρ at owned triangles with the free islands connected to the rest (collective).

    A straight line two filter radii wide is added along the shortest way from each island to
    attached print of its panel, or to an island that has its line already.
    """
    radius = densities_of(problem.fields).filter.radius

    def bridged(at: np.ndarray, islands: Sequence[BaseGeometry], rest: BaseGeometry) -> Bools:
        bridge = np.zeros(len(at), dtype=bool)
        for island in islands if not rest.is_empty else ():
            line = shapely.shortest_line(island, rest)
            bridge |= shapely.dwithin(at, line, radius)
            rest = shapely.union_all([rest, island, line])
        return bridge

    return np.where(_chosen(problem, printed, bridged), 1.0, result.density)


def _chosen(problem: DesignProblem, printed: PrintedDesign, choice: Choice) -> Bools:
    """Return which owned triangles are meant, by their centroids (collective)."""
    skin = problem.skin
    pattern = skin.pattern

    def find() -> Bools:
        chosen = np.zeros(len(pattern.panel), dtype=bool)
        for panel in range(len(pattern.panel_names)):
            islands = [i.polygon for i in printed.before.free_islands if i.panel == panel]
            if islands:
                rest = shapely.difference(printed.contours[panel], shapely.union_all(islands))
                cells = np.flatnonzero(pattern.panel == panel)
                at = shapely.points(pattern.centroids[cells])
                chosen[cells] = choice(at, islands, rest)
        return chosen

    return on_first_rank(skin.comm, find)[skin.owned_cells]
