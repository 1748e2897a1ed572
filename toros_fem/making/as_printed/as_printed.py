"""The printed design: thresholded, cleaned, measured, and simulated again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import on_first_rank, require_alike
from toros_fem.base.validation import require_kind
from toros_fem.design.loop.fields import densities_of
from toros_fem.design.loop.journal import Journal, kept_evaluation
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.making.print.cleaning import (
    CleanedRegions,
    Panels,
    clean,
    panels_of,
    require_island_area,
)
from toros_fem.making.print.contours import printed_regions
from toros_fem.making.print.printability import (
    DEFAULT_LIMITS,
    Printability,
    PrintLimits,
    printability,
    printed_cells,
)
from toros_fem.meshes.pattern import Pattern

# Smoothing length of contours, over the edge length of the mesh.
SMOOTHING = 0.5


@dataclass(frozen=True, eq=False)
class PrintedDesign:
    """The print of a design and its simulation; that of the whole skin where a part is designed.

    Attributes:
        pattern: The pattern that is printed on.
        cleaned: Print on each panel, and what it was made of.
        limits: Limits of the printer.
        before: Printability of the contours.
        after: Printability of the print.
        cells: Whether each triangle of the pattern is printed, (t,).
        evaluation: The binary pattern, simulated; None without an equilibrium.
        failure: Reason for the missing equilibrium; empty if there is one.
    """

    pattern: Pattern
    cleaned: CleanedRegions
    limits: PrintLimits
    before: Printability
    after: Printability
    cells: Bools
    evaluation: Evaluation | None
    failure: str

    @property
    def contours(self) -> list[BaseGeometry]:
        """Regions on each panel before any cleaning: where ρ̃ exceeds η, or lines as laid, in m."""
        return self.cleaned.contours

    @property
    def regions(self) -> list[BaseGeometry]:
        """Print on each panel, polygons in m."""
        return self.cleaned.regions


def contour_values(problem: DesignProblem, density: Floats) -> tuple[Floats, Floats]:
    """Return ρ̃ at all flat points and at all centroids, with prescribed values kept (collective).

    Args:
        problem: The design problem.
        density: ρ at owned triangles.
    """
    skin, fields = problem.skin, densities_of(problem.fields)
    pattern = skin.pattern
    density = fields.with_passive(density)
    at_points = fields.filter.at_points(density)
    at_centroids = skin.gather_cells(fields.filter.forward(density))
    designed = skin.gather_cells(problem.designed.astype(np.float64)) > 0
    prescribed = skin.gather_cells(density)
    at_centroids = np.where(designed, at_centroids, prescribed)
    # A point whose triangles are all prescribed is prescribed too.
    corner = pattern.flat_triangles
    free = np.bincount(corner.ravel(), np.repeat(designed, 3), minlength=len(at_points)) > 0
    fixed = corner[~designed]
    at_points[fixed] = np.where(free[fixed], at_points[fixed], prescribed[~designed][:, None])
    return at_points, at_centroids


def remove_islands(problem: DesignProblem, result: DesignResult, printed: PrintedDesign) -> Floats:
    """Return ρ at owned triangles without the free islands of its contours (collective).

    An island may carry load: `connect_islands` keeps it. Where a part of the skin is designed, its
    triangles and panels are the first of the whole, at the same flat places.

    Args:
        problem: The design problem.
        result: Result of the design loop.
        printed: Its print.
    """
    skin = problem.skin
    pattern, comm = skin.pattern, skin.comm

    def find() -> Bools:
        clear = np.zeros(len(pattern.panel), dtype=bool)
        radius = densities_of(problem.fields).filter.radius
        for panel in {island.panel for island in printed.before.free_islands}:
            islands = [i.polygon for i in printed.before.free_islands if i.panel == panel]
            together = shapely.union_all(islands)
            rest = shapely.difference(printed.contours[panel], together)
            # Densities up to R beyond its border contribute to an island. Those closer than R/2 to
            # the rest of the print contribute to the rest as well and stay.
            cells = np.flatnonzero(pattern.panel == panel)
            at = shapely.points(pattern.centroids[cells])
            near = shapely.dwithin(at, together, radius)
            clear[cells] |= near & ~shapely.dwithin(at, rest, radius / 2)
        return clear

    clear = on_first_rank(comm, find)
    return np.where(clear[skin.owned_cells], 0.0, result.density)


def connect_islands(problem: DesignProblem, result: DesignResult, printed: PrintedDesign) -> Floats:
    """Return ρ at owned triangles with the free islands connected to the rest (collective).

    A straight line two filter radii wide is added along the shortest way from each island to other
    print of its panel.

    Args:
        problem: The design problem.
        result: Result of the design loop.
        printed: Its print.
    """
    skin = problem.skin
    pattern = skin.pattern

    def find() -> Bools:
        bridge = np.zeros(len(pattern.panel), dtype=bool)
        for island in printed.before.free_islands:
            if island.panel >= len(pattern.panel_names):
                continue  # the mirror image of an island on the part
            cells = np.flatnonzero(pattern.panel == island.panel)
            rest = shapely.difference(printed.contours[island.panel], island.polygon)
            if rest.is_empty:
                continue
            line = shapely.shortest_line(island.polygon, rest)
            at = shapely.points(pattern.centroids[cells])
            bridge[cells] |= shapely.dwithin(at, line, densities_of(problem.fields).filter.radius)
        return bridge

    bridge = on_first_rank(skin.comm, find)
    return np.where(bridge[skin.owned_cells], 1.0, result.density)


def as_printed(
    problem: DesignProblem,
    result: DesignResult,
    limits: PrintLimits = DEFAULT_LIMITS,
    *,
    island_area: float = 0.0,
    domain: Panels | None = None,
    journal: Journal | None = None,
) -> PrintedDesign:
    """Threshold a design at η, clean, measure and simulate it as a binary pattern (collective).

    Args:
        problem: The design problem.
        result: Result of the design loop.
        limits: Limits of the printer.
        island_area: Free islands smaller than this, in m², are removed; larger ones are bridged.
        domain: What is cleaned, for a pattern that goes on beyond its border; None: its panels.
        journal: Keeps the simulation; None keeps nothing.

    Raises:
        ParameterError: The area is negative, or not below the pattern's; or an argument has
            another type.
    """
    require_kind("problem", problem, DesignProblem, "a design problem, a ShapeDesign for instance")
    require_kind("result", result, DesignResult, "the DesignResult of optimize")
    require_kind("limits", limits, PrintLimits, "PrintLimits")
    skin = problem.skin
    require_alike(skin.comm, limits=limits, island_area=island_area)
    pattern, whole = skin.pattern, problem.whole
    require_island_area(pattern, island_area)
    at_points, at_centroids = contour_values(problem, result.density)
    eta = densities_of(problem.fields).projection.eta
    smoothing = SMOOTHING * float(np.sqrt(4 / np.sqrt(3) * pattern.areas.mean()))
    if whole is not None:
        pattern = whole.pattern
        at_points, at_centroids = at_points[whole.flat], whole.at_cells(at_centroids)

    def cleaning() -> CleanedRegions:
        contours = printed_regions(pattern, at_points, at_centroids, eta)
        onto = domain or panels_of(skin.pattern, whole)
        return clean(onto, contours, limits, island_area, smoothing)

    def simulate(cells: Bools) -> Evaluation:
        return kept_evaluation(
            journal, problem, lambda: problem.simulate_binary(cells, result.final)
        )

    return print_regions(problem, pattern, cleaning, simulate, limits)


def print_regions(
    problem: DesignProblem,
    pattern: Pattern,
    cleaning: Callable[[], CleanedRegions],
    simulate: Callable[[Bools], Evaluation],
    limits: PrintLimits,
) -> PrintedDesign:
    """Measure and simulate printed regions (collective).

    Args:
        problem: The design problem.
        pattern: The whole pattern that is printed on.
        cleaning: Returns the regions on each of its panels; called on the first rank.
        simulate: Evaluates a binary pattern, given for the owned triangles.
        limits: Limits of the printer.

    Raises:
        PatternError: The skin is moulded.
    """
    skin = problem.skin
    pattern.require_flat_panels("a print")

    def inspect() -> tuple[CleanedRegions, Printability, Printability, Bools]:
        cleaned = cleaning()
        before = printability(pattern, cleaned.contours, limits)
        after = printability(pattern, cleaned.regions, limits)
        return cleaned, before, after, printed_cells(pattern, cleaned.regions)

    cleaned, before, after, cells = on_first_rank(skin.comm, inspect)
    evaluation, failure = None, ""
    try:
        evaluation = simulate(cells[skin.owned_cells])
    except NoEquilibriumError as caught:  # raised by all ranks or by none
        failure = str(caught)
    return PrintedDesign(pattern, cleaned, limits, before, after, cells, evaluation, failure)
