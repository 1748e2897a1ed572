"""A design as it is printed: thresholded, cleaned, measured, and simulated again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem._mpi import on_first_rank
from toros_fem._types import Floats
from toros_fem.design.loop import DesignResult
from toros_fem.design.problem import DesignProblem, Evaluation
from toros_fem.errors import NoEquilibriumError
from toros_fem.fabrication.contours import printed_regions
from toros_fem.fabrication.islands import Cleaned, clean
from toros_fem.fabrication.printability import (
    Printability,
    PrintLimits,
    printability,
    printed_cells,
)
from toros_fem.meshes.pattern import Pattern

DEFAULT_LIMITS = PrintLimits()


@dataclass(frozen=True, eq=False)
class PrintedDesign:
    """What leaves the printer, and what it does; of the whole where a part is designed.

    Attributes:
        pattern: What is printed on.
        contours: The contours of ρ̃ at η on each panel, in m.
        cleaned: What is printed on each panel, with what was dropped and filled on the way.
        limits: Below which widths and gaps count as offences.
        before: Printability of the bare contours.
        after: Printability of what is printed.
        cells: Which of its triangles are printed, (t,).
        evaluation: The binary pattern simulated at the design's pressure; None if it has no
            equilibrium there.
        failure: Why it has none.
    """

    pattern: Pattern
    contours: list[BaseGeometry]
    cleaned: Cleaned
    limits: PrintLimits
    before: Printability
    after: Printability
    cells: npt.NDArray[np.bool_]
    evaluation: Evaluation | None
    failure: str

    @property
    def regions(self) -> list[BaseGeometry]:
        """What is printed on each panel, in m."""
        return self.cleaned.regions


def contour_values(problem: DesignProblem, density: Floats) -> tuple[Floats, Floats]:
    """ρ̃ at all flat points and at all centroids, what is given as it is given (collective).

    Args:
        problem: The design problem.
        density: ρ at owned triangles.
    """
    skin = problem.skin
    pattern = skin.pattern
    density = problem.with_passive(density)
    at_points = problem.filter.at_points(density)
    at_centroids = skin.gather_cells(problem.filter.forward(density))
    designed = skin.gather_cells(problem.designed.astype(np.float64)) > 0
    given = skin.gather_cells(density)
    at_centroids = np.where(designed, at_centroids, given)
    # A point all of whose triangles are given is given too.
    corner = pattern.flat_triangles
    free = np.bincount(corner.ravel(), np.repeat(designed, 3), minlength=len(at_points)) > 0
    fixed = corner[~designed]
    at_points[fixed] = np.where(free[fixed], at_points[fixed], given[~designed][:, None])
    return at_points, at_centroids


def remove_islands(problem: DesignProblem, result: DesignResult, printed: PrintedDesign) -> Floats:
    """ρ at owned triangles without what makes free islands of its contours (collective).

    What carries load may be an island: `connect_islands` keeps it.

    Of a whole its part has the first triangles and panels, at the same flat places.

    Args:
        problem: The design problem.
        result: What the design loop arrived at.
        printed: What is printed of it.
    """
    skin = problem.skin
    pattern, comm = skin.pattern, skin.comm

    def find() -> npt.NDArray[np.bool_]:
        clear = np.zeros(len(pattern.panel), dtype=bool)
        radius = problem.filter.radius
        for panel in {island.panel for island in printed.before.free_islands}:
            islands = [i.polygon for i in printed.before.free_islands if i.panel == panel]
            together = shapely.union_all(islands)
            rest = shapely.difference(printed.contours[panel], together)
            # What feeds an island lies up to R beyond its border; what lies closer to the rest of
            # the print than half of that feeds this too.
            cells = np.flatnonzero(pattern.panel == panel)
            at = shapely.points(pattern.centroids[cells])
            near = shapely.dwithin(at, together, radius)
            clear[cells] |= near & ~shapely.dwithin(at, rest, radius / 2)
        return clear

    clear = on_first_rank(comm, find)
    return np.where(clear[skin.owned_cells], 0.0, result.density)


def connect_islands(problem: DesignProblem, result: DesignResult, printed: PrintedDesign) -> Floats:
    """ρ at owned triangles with the free islands of its contours joined to the rest (collective).

    Each by a straight line two filter radii wide, the shortest way to other print of the panel.

    Args:
        problem: The design problem.
        result: What the design loop arrived at.
        printed: What is printed of it.
    """
    skin = problem.skin
    pattern = skin.pattern

    def find() -> npt.NDArray[np.bool_]:
        joined = np.zeros(len(pattern.panel), dtype=bool)
        for island in printed.before.free_islands:
            if island.panel >= len(pattern.panel_names):
                continue  # an image of one on the part
            cells = np.flatnonzero(pattern.panel == island.panel)
            rest = shapely.difference(printed.contours[island.panel], island.polygon)
            if rest.is_empty:
                continue
            line = shapely.shortest_line(island.polygon, rest)
            at = shapely.points(pattern.centroids[cells])
            joined[cells] |= shapely.dwithin(at, line, problem.filter.radius)
        return joined

    joined = on_first_rank(skin.comm, find)
    return np.where(joined[skin.owned_cells], 1.0, result.density)


def as_printed(
    problem: DesignProblem,
    result: DesignResult,
    limits: PrintLimits = DEFAULT_LIMITS,
    *,
    island_area: float = 0.0,
    hole_area: float = 0.0,
) -> PrintedDesign:
    """Threshold a design at η, clean it, measure it, simulate it as binary pattern (collective).

    Args:
        problem: The design problem.
        result: What the design loop arrived at.
        limits: Below which widths and gaps count as offences.
        island_area: Islands that hang on nothing and are smaller than this, in m², are dropped.
        hole_area: Holes smaller than this, in m², are filled.
    """
    skin = problem.skin
    pattern, comm, whole = skin.pattern, skin.comm, problem.whole
    at_points, at_centroids = contour_values(problem, result.density)
    if whole is not None:
        pattern = whole.pattern
        at_points, at_centroids = at_points[whole.flat], whole.at_cells(at_centroids)

    def inspect() -> tuple[
        list[BaseGeometry], Cleaned, Printability, Printability, npt.NDArray[np.bool_]
    ]:
        regions = printed_regions(pattern, at_points, at_centroids, problem.projection.eta)
        before = printability(pattern, regions, limits)
        cleaned = clean(pattern, regions, island_area, hole_area)
        touched = cleaned.dropped or cleaned.filled
        after = printability(pattern, cleaned.regions, limits) if touched else before
        return regions, cleaned, before, after, printed_cells(pattern, cleaned.regions)

    regions, cleaned, before, after, cells = on_first_rank(comm, inspect)
    evaluation, failure = None, ""
    try:
        evaluation = problem.simulate_binary(cells[skin.owned_cells], result.final)
    except NoEquilibriumError as caught:  # raised by all ranks or by none
        failure = str(caught)
    return PrintedDesign(
        pattern, regions, cleaned, limits, before, after, cells, evaluation, failure
    )
