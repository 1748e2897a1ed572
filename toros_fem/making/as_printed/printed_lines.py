"""The print of lines that come as polygons, simulated on a mesh of its own."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import require_kind
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.physics import Pressure
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.making.as_printed.as_printed import PrintedDesign, printed, require_printable
from toros_fem.making.print.cleaning import CleanedRegions, clean, panels_of
from toros_fem.making.print.printability import DEFAULT_LIMITS, PrintLimits
from toros_fem.making.print.regions import part_regions, regions_on
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import make_transfer


@collective("problem.comm", owned=("journal",))
def printed_lines(
    problem: DesignProblem,
    pattern: Pattern,
    regions: Regions,
    limits: PrintLimits = DEFAULT_LIMITS,
    *,
    island_area: float = 0.0,
    near: tuple[Pattern, Floats] | None = None,
    pressure: Pressure | None = None,
    journal: Journal | None = None,
) -> PrintedDesign:
    """Clean, measure and simulate lines that come as polygons (collective).

    A mesh whose edges follow the lines, by `Case.following`, sees them as they are. On others lines
    come out too stiff or with steps in their borders (docs/manufacture.md).

    Args:
        problem: It is on the mesh that the print is simulated on.
        pattern: The pattern that the polygons belong to: the same panels on any mesh.
        island_area: As of `as_printed`.
        near: A pattern with the same panels and positions of all its vertices, (n, 3), in m, to
            start from: those of the relaxed design, or of the print on a coarser mesh. None starts
            from the assembled shape.

    Raises:
        PanelError: The panels are others, or the number of regions is not theirs.
        ParameterError: The area is negative, or not below the pattern's.
    """
    require_kind("pattern", pattern, Pattern, "the Pattern of the polygons")
    require_printable(problem, limits, island_area)
    part, whole = problem.skin.pattern, problem.whole
    start = None if near is None else state_near(problem, *near)

    def cleaning() -> CleanedRegions:
        panels = panels_of(part, whole)
        found = panels.whole(regions_on(pattern, regions, part))
        return clean(panels, found, limits, island_area)

    return printed(problem, cleaning, limits, start=start, pressure=pressure, journal=journal)


@collective("comm")
def case_of_print(
    comm: MPI.Comm, case: Case, pattern: Pattern, regions: Regions
) -> tuple[Case, list[BaseGeometry]]:
    """Return a case that follows a print, with smoothed strains, and `print_on` it (collective)."""
    own = print_on(comm, case, pattern, regions)
    return case.following(comm, own).smoothed(), own


@collective("comm")
def print_on(
    comm: MPI.Comm, case: Case, pattern: Pattern, regions: Regions, *, any_size: bool = False
) -> list[BaseGeometry]:
    """Return a print on the pattern of a case (collective).

    The print's own pattern is another mesh of the whole skin, perhaps of another size.

    Raises:
        PanelError: The panels or, unless they may, their sizes are others, or the number of
            regions is not theirs.
    """

    def laid() -> list[BaseGeometry]:
        there = regions_on(pattern, regions, case.whole.pattern, any_size=any_size)
        return part_regions(case.pattern, there)

    return on_first_rank(comm, laid)


@collective("problem.comm")
def state_near(problem: DesignProblem, pattern: Pattern, positions: Floats) -> Any:
    """Return the state of a problem with the shape of another mesh of its panels (collective).

    Positions, (n, 3), in m, are those of all of its vertices.
    """
    there = make_transfer(pattern, problem.skin.pattern).positions(positions)
    return problem.physics.state_at(there)
