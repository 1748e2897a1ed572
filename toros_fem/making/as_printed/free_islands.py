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
    is told: specks are removed and all others joined to the rest, or all are removed, whichever
    does less harm to the objective, and the stages of the options follow. A design whose print has
    none is returned as it is. The arguments are those of `optimize`.
    """
    require_kind("result", result, DesignResult, "the DesignResult of optimize")
    require_kind("printed", printed, PrintedDesign, "a PrintedDesign, by as_printed")
    problem, near = result.problem, result.final.equilibrium
    if not on_first_rank(problem.comm, lambda: len(printed.before.free_islands)):
        return result
    starts, objectives = without_free_islands(problem, result, printed), []
    for density in starts:
        objectives.append(np.inf)
        with suppress(NoEquilibriumError):  # raised by all ranks or by none
            found = problem.simulate(density, near.state, near.pressures, trial=True)
            objectives[-1] = found.objective
    start = starts[int(np.argmin(objectives))]
    return optimize(problem, options, start=start, callback=callback, after=result, journal=journal)


def without_free_islands(
    problem: DesignProblem, result: DesignResult, printed: PrintedDesign
) -> tuple[Floats, Floats]:
    """Return ρ at owned triangles with free islands joined, and without any (collective).

    An island may carry load: so it is kept by a straight line two filter radii wide, along the
    shortest way to attached print of its panel, or to an island that has its line already. Specks,
    no larger than a disc of the filter's radius, are removed all the same. Islands
    are those of the contours. Where a part of the skin is designed, its triangles and panels are
    the first of the whole, at the same flat places.
    """
    skin, radius = problem.skin, densities_of(problem.fields).filter.radius
    pattern = skin.pattern

    def find() -> Bools:
        cleared, specks, bridged = found = np.zeros((3, len(pattern.panel)), dtype=bool)
        for panel in {island.panel for island in printed.before.free_islands}:
            islands = [i.polygon for i in printed.before.free_islands if i.panel == panel]
            rest = shapely.difference(printed.contours[panel], shapely.union_all(islands))
            cells = np.flatnonzero(pattern.panel == panel)
            at = shapely.points(pattern.centroids[cells])
            # Densities up to R beyond its border contribute to an island. Those closer than R/2 to
            # the rest of the print contribute to the rest as well and stay.
            small = [island for island in islands if island.area <= np.pi * radius**2]
            for away, gone in ((islands, cleared), (small, specks)):
                every = shapely.union_all(away)
                left = shapely.difference(printed.contours[panel], every)
                near = shapely.dwithin(at, every, radius)
                gone[cells] = near & ~shapely.dwithin(at, left, radius / 2)
            for island in [] if rest.is_empty else [i for i in islands if i not in small]:
                line = shapely.shortest_line(island, rest)
                bridged[cells] |= shapely.dwithin(at, line, radius)
                rest = shapely.union_all([rest, island, line])
        return found

    cleared, specks, bridged = on_first_rank(skin.comm, find)[:, skin.owned_cells]
    kept = np.where(specks, 0.0, result.density)
    return np.where(bridged, 1.0, kept), np.where(cleared, 0.0, result.density)
