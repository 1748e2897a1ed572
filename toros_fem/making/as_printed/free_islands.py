"""Designs that go on from a print with free islands: without them, or with them joined."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import shapely

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import require_kind
from toros_fem.design.loop.fields import densities_of
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import Callback, DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.making.as_printed.as_printed import PrintedDesign


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
    patterns, objectives = without_free_islands(problem, result, printed), list[float]()
    for density in patterns:
        objectives.append(np.inf)
        with suppress(NoEquilibriumError):  # raised by all ranks or by none
            found = problem.simulate(density, near.state, near.pressures, trial=True)
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
