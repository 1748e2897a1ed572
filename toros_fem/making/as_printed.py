"""The printed design, of a density or of lines: cleaned, simulated again, and measured."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import NoEquilibriumError, PatternError
from toros_fem.base.mpi import on_first_rank, total
from toros_fem.base.validation import Bools, Floats, require_kind
from toros_fem.design.loop.fields import densities_of
from toros_fem.design.loop.journal import Journal, kept_evaluation
from toros_fem.design.loop.loop import Callback, DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.physics import Pressure
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign, ShapeProblem
from toros_fem.making.cleaning import CleanedRegions, Panels, clean, panels_of, require_island_area
from toros_fem.making.contours import printed_regions
from toros_fem.making.printability import (
    DEFAULT_LIMITS,
    Printability,
    PrintLimits,
    part_regions,
    printability,
    printed_cells,
    printed_fractions,
    regions_on,
)
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.transfer import make_transfer
from toros_fem.meshes.triangles import equilateral_edge

# A mesh, and the positions of its vertices, (n, 3), in m.
Shape = tuple[Pattern, Floats]
# Smoothing length of contours, over the edge length of the mesh.
SMOOTHING = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class PrintedDesign:
    """The print of a design and its simulation; that of the whole skin where a part is designed.

    Attributes:
        pattern: The pattern that is printed on; of a shape design its mesh has the print's borders.
        cleaned: Print on each panel, and what it was made of.
        limits: Limits of the printer.
        cells: Whether each triangle of the pattern is printed, (t,): whether its centroid is.
        evaluation: The print, simulated, by its own problem; None without an equilibrium.
        failure: Reason for the missing equilibrium, or mesh; empty if there is one.
    """

    pattern: Pattern
    cleaned: CleanedRegions
    limits: PrintLimits
    cells: Bools
    evaluation: Evaluation | None
    failure: str

    @cached_property
    def before(self) -> Printability:
        """Printability of the contours."""
        return printability(self.pattern, self.contours, self.limits)

    @cached_property
    def after(self) -> Printability:
        """Printability of the print."""
        return printability(self.pattern, self.regions, self.limits)

    @property
    def metrics(self) -> dict[str, float]:
        """Metrics of the print, by key; empty without an equilibrium (collective)."""
        return {} if self.evaluation is None else self.evaluation.metrics

    @property
    def contours(self) -> list[BaseGeometry]:
        """Print before any cleaning: where ρ̃ exceeds η, or lines as laid."""
        return self.cleaned.contours

    @property
    def regions(self) -> list[BaseGeometry]:
        """The print on each panel."""
        return self.cleaned.regions

    def __repr__(self) -> str:
        panels = sum(not region.is_empty for region in self.regions)
        state = self.failure if self.evaluation is None else repr(self.evaluation.equilibrium)
        return f"PrintedDesign(print on {panels} panels, {state})"


def contour_values(problem: DesignProblem, density: Floats) -> tuple[Floats, Floats]:
    """Return ρ̃ at all flat points and centroids, by ρ at owned triangles (collective).

    Prescribed values are kept.
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


def as_printed(
    problem: DesignProblem,
    result: DesignResult,
    limits: PrintLimits = DEFAULT_LIMITS,
    *,
    island_area: float = 0.0,
    journal: Journal | None = None,
) -> PrintedDesign:
    """Threshold a design at η, clean, measure and simulate it (collective).

    A `ShapeDesign` is simulated on a mesh whose edges are the borders of the print. Free islands
    smaller than the area, in m², are removed; larger ones are bridged.

    Raises:
        ParameterError: The area is negative, or not below the pattern's.
    """
    cleaned = cleaned_print(problem, result, limits, island_area=island_area)
    return printed(problem, lambda: cleaned, limits, like=result.final, journal=journal)


def cleaned_print(
    problem: DesignProblem,
    result: DesignResult,
    limits: PrintLimits,
    *,
    island_area: float = 0.0,
    domain: Panels | None = None,
) -> CleanedRegions:
    """Threshold a design at η and clean it, as of `as_printed` (collective).

    What is cleaned, where a pattern goes on beyond its border, is the domain; None: its panels.
    """
    require_kind("result", result, DesignResult, "the DesignResult of optimize")
    require_printable(problem, limits, island_area)
    pattern, whole = problem.skin.pattern, problem.whole
    at_points, at_centroids = contour_values(problem, result.density)
    eta = densities_of(problem.fields).projection.eta
    smoothing = SMOOTHING * equilateral_edge(pattern.areas.mean())

    def cleaning() -> CleanedRegions:
        values = at_points[whole.flat], whole.at_cells(at_centroids)
        contours = printed_regions(whole.pattern, *values, eta)
        return clean(domain or panels_of(pattern, whole), contours, limits, island_area, smoothing)

    return on_first_rank(problem.comm, cleaning)


def printed_lines(
    problem: DesignProblem,
    pattern: Pattern,
    regions: Regions,
    limits: PrintLimits = DEFAULT_LIMITS,
    *,
    island_area: float = 0.0,
    near: Shape | None = None,
    pressure: Pressure | None = None,
    journal: Journal | None = None,
) -> PrintedDesign:
    """Clean and simulate lines that come as polygons (collective).

    The mesh of the simulation has their borders, as in `as_printed`.

    Args:
        problem: What is designed, on any mesh.
        pattern: The pattern that the polygons belong to: the same panels on any mesh.
        island_area: As of `as_printed`.
        near: A pattern with the same panels and positions of all its vertices, (n, 3), in m, to
            start from: those of the relaxed design, or of the print on a coarser mesh. None, or a
            skin that is flat at rest, starts from the assembled shape.

    Raises:
        PanelError: The panels are others, or the number of regions is not theirs.
        ParameterError: The area is negative, or not below the pattern's.
    """
    require_kind("pattern", pattern, Pattern, "the Pattern of the polygons")
    require_printable(problem, limits, island_area)
    part, whole = problem.skin.pattern, problem.whole

    def cleaning() -> CleanedRegions:
        panels = panels_of(part, whole)
        found = panels.whole(regions_on(pattern, regions, part))
        return clean(panels, found, limits, island_area)

    return printed(problem, cleaning, limits, near=near, pressure=pressure, journal=journal)


def state_near(problem: DesignProblem, pattern: Pattern, *positions: Floats) -> Any:
    """Return the state of a problem with the shape of another mesh of its panels (collective).

    Positions, (n, 3), in m, are those of all of its vertices, of the first pose or of all; the
    state has as many.
    """
    transfer = make_transfer(pattern, problem.skin.pattern)
    states = [
        pose.physics.state_at(transfer.positions(shape))
        for pose, shape in zip(problem.every, positions, strict=False)
    ]
    return states[0] if len(states) == 1 else tuple(states)


def require_printable(problem: DesignProblem, limits: PrintLimits, island_area: float) -> None:
    """Check types and values of what a print is made of, alike on all ranks (collective)."""
    require_kind("problem", problem, DesignProblem, "a design problem, a ShapeDesign for instance")
    require_kind("limits", limits, PrintLimits, "PrintLimits")
    require_island_area(problem.skin.pattern, island_area)


def printed(
    problem: DesignProblem,
    cleaning: Callable[[], CleanedRegions],
    limits: PrintLimits,
    *,
    like: Evaluation | None = None,
    near: Shape | Callable[[], Shape] | None = None,
    pressure: Pressure | None = None,
    journal: Journal | None = None,
) -> PrintedDesign:
    """Simulate a print as `simulate_binary` does (collective).

    A `ShapeDesign` is simulated on a mesh whose edges are the borders of the print, every other
    problem on its own mesh. A skin that is flat at rest is inflated from rest.

    Args:
        problem: The design problem; where nothing is designed its mesh is that of the print.
        cleaning: Returns the print of the whole pattern, on the first rank.
        limits: Limits of the printer.
        like: The design, of this problem.
        near: A mesh of the panels and positions of its vertices, (n, 3), in m, to start from, or a
            function that returns both where the print is not in the journal; None takes the shape
            of the design.
        pressure, journal: As of `simulate_binary` and `optimize`.

    Raises:
        PatternError: The skin is moulded.
    """
    skin = problem.skin
    problem.whole.pattern.require_flat_panels("a print")
    shapes: list[Floats] = []  # of further poses

    def made() -> tuple[CleanedRegions, list[BaseGeometry]]:
        cleaned = cleaning()
        return cleaned, part_regions(skin.pattern, cleaned.regions)

    cleaned, regions = on_first_rank(skin.comm, made)
    if isinstance(problem, ShapeDesign) and total(skin.comm, problem.designed.sum()) > 0:
        try:
            problem = problem.for_print(regions)
        except PatternError as caught:  # raised by all ranks or by none
            return unmeshed(problem, cleaned, limits, str(caught))
        if like is not None:
            if near is None:
                first, *shapes = (skin.gather_vertices(e.equilibrium.positions) for e in like.every)
                near = skin.pattern, first
            like = _carried(like, skin, problem.skin)
        skin = problem.skin
    pattern = problem.whole.pattern
    if isinstance(problem, ShapeDesign):  # all densities are prescribed
        part = problem.fields.with_passive(np.zeros(len(skin.owned_cells)))
        cells: Bools = problem.whole.at_cells(skin.gather_cells(part)) > 0.5
    else:
        of_all = on_first_rank(skin.comm, lambda: printed_fractions(skin.pattern, regions))
        part = of_all[skin.owned_cells]
        cells = on_first_rank(skin.comm, lambda: printed_cells(pattern, cleaned.regions))

    def simulate() -> Evaluation:
        start = None
        if isinstance(problem, ShapeProblem):
            # Layers that fold one way or the other have several stable shapes. The skin takes the
            # one that it is inflated to.
            if near is not None and not problem.flat_at_rest:
                there, shape = near() if callable(near) else near
                start = state_near(problem, there, shape, *shapes)
            if start is None:
                start = problem.solver.model.assembled
        return problem.simulate_binary(part, like, start=start, pressure=pressure)

    evaluation, failure = None, ""
    try:
        evaluation = kept_evaluation(journal, problem, simulate, like)
    except NoEquilibriumError as caught:  # raised by all ranks or by none
        failure = str(caught)
    return PrintedDesign(pattern, cleaned, limits, cells, evaluation, failure)


def unmeshed(
    problem: DesignProblem, cleaned: CleanedRegions, limits: PrintLimits, failure: str
) -> PrintedDesign:
    """Return a print whose borders cannot be meshed, on the mesh of its design (collective)."""
    pattern = problem.whole.pattern
    cells = on_first_rank(problem.comm, lambda: printed_cells(pattern, cleaned.regions))
    return PrintedDesign(pattern, cleaned, limits, cells, None, failure)


def _carried(like: Evaluation, skin: Skin, other: Skin) -> Evaluation:
    """Return a design with its densities on another mesh (collective)."""
    transfer = make_transfer(skin.pattern, other.pattern)
    fields = (like.density, like.filtered, like.projected)
    density, filtered, projected = (
        transfer.at_cells(skin.gather_cells(v))[other.owned_cells] for v in fields
    )
    return replace(like, density=density, filtered=filtered, projected=projected)


def polished(
    result: DesignResult,
    printed: PrintedDesign,
    options: DesignOptions,
    *,
    callback: Callback | None = None,
    journal: Journal | None = None,
) -> DesignResult:
    """Go on with a design whose print has free islands, from one without them (collective).

    Cleaning removes or bridges islands that the design relies on, which moves the shape. The design
    is told: none, specks or all are removed and the others joined to the rest, whichever does the
    least harm to the objective, and the stages of the options follow. A design whose print has none
    is returned as it is. The arguments are those of `optimize`.
    """
    require_kind("result", result, DesignResult, "the DesignResult of optimize")
    require_kind("printed", printed, PrintedDesign, "a PrintedDesign, by as_printed")
    if not on_first_rank(result.problem.comm, lambda: len(printed.before.free_islands)):
        return result
    start, *_ = patterns_without_islands(result, printed)
    return optimize(
        result.problem, options, start=start, callback=callback, after=result, journal=journal
    )


def patterns_without_islands(result: DesignResult, printed: PrintedDesign) -> list[Floats]:
    """Return densities as of `without_free_islands`, that with the least objective first.

    Those without an equilibrium are left out, unless none has one (collective).
    """
    problem, near = result.problem, result.final.equilibrium
    states = [one.equilibrium.state for one in result.final.every]
    start = tuple(states) if problem.poses else near.state
    patterns, objectives = without_free_islands(problem, result, printed), list[float]()
    for density in patterns:
        objectives.append(np.inf)
        with suppress(NoEquilibriumError):  # raised by all ranks or by none
            found = problem.simulate(density, start, near.pressures, trial=True)
            objectives[-1] = found.objective
    least_first = np.argsort(objectives, kind="stable")
    return [patterns[k] for k in least_first if np.isfinite(objectives[k])] or [*patterns[:1]]


def without_free_islands(
    problem: DesignProblem, result: DesignResult, printed: PrintedDesign
) -> tuple[Floats, ...]:
    """Return densities at owned triangles without free islands, all that differ (collective).

    None, specks or all of the islands are removed. Specks are no larger than a disc of the filter's
    radius. The others may carry load: each is kept by a straight line two radii wide, along the
    shortest way to attached print of its panel, or to an island that has its line already. Islands
    are those of the contours. Where a part of the skin is designed, its triangles and panels are
    the first of the whole, at the same flat places.
    """
    skin, radius = problem.skin, densities_of(problem.fields).filter.radius
    pattern = skin.pattern

    def find() -> Bools:
        ways = np.zeros((3, 2, len(pattern.panel)), dtype=bool)
        for panel in {island.panel for island in printed.before.free_islands}:
            islands = [i.polygon for i in printed.before.free_islands if i.panel == panel]
            specks = [island for island in islands if island.area <= np.pi * radius**2]
            print_of_panel = printed.contours[panel]
            attached = shapely.difference(print_of_panel, shapely.union_all(islands))
            cells = np.flatnonzero(pattern.panel == panel)
            at = shapely.points(pattern.centroids[cells])
            for removed, (gone, lines) in zip(([], specks, islands), ways, strict=True):
                # Densities up to R beyond its border contribute to an island. Those closer than
                # R/2 to the rest of the print contribute to the rest as well and stay.
                away = shapely.union_all(removed)
                left = shapely.difference(print_of_panel, away)
                near = shapely.dwithin(at, away, radius)
                gone[cells] = near & ~shapely.dwithin(at, left, radius / 2)
                rest = attached
                for island in [] if rest.is_empty else [i for i in islands if i not in removed]:
                    line = shapely.shortest_line(island, rest)
                    lines[cells] |= shapely.dwithin(at, line, radius)
                    rest = shapely.union_all([rest, island, line])
        return np.unique(ways, axis=0)

    ways = on_first_rank(skin.comm, find)[..., skin.owned_cells]
    return tuple(np.where(lines, 1.0, np.where(gone, 0.0, result.density)) for gone, lines in ways)
