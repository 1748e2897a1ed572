"""Printed lines on a mesh along their borders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import PatternError
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.lines.laid_lines import LaidLines
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign, Shape, printed, unmeshed
from toros_fem.making.print.cleaning import CleanedRegions, clean, panels_of
from toros_fem.making.print.regions import part_regions, regions_on
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.other_mesh import SimulatedPrint, near_on_coarser

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import Level


@dataclass(frozen=True, eq=False)
class LinePrint:
    """Lines on a mesh along their borders, printed and simulated.

    Attributes:
        case: What is designed, on this mesh.
        regions: The lines on its panels, polygons in m.
        beyond: What a finer mesh has told of a similar print, minus what its own mesh did, at the
            vertices of this mesh, (n, 3), in m; None where no finer mesh was asked.
    """

    case: Case
    regions: Regions
    problem: ShapeDesign
    printed: PrintedDesign
    beyond: Floats | None = None

    @property
    def metrics(self) -> dict[str, float]:
        """Metrics of the shape, by key; empty without an equilibrium (collective)."""
        if self.printed.failure:
            return {}
        return {metric.key: metric.value(*self.shape) for metric in self.problem.metrics}

    @property
    def shape(self) -> Shape:
        """The mesh, and its shape with what a finer mesh tells beyond (collective)."""
        own = self.own_shape
        return self.case.pattern, own if self.beyond is None else own + self.beyond

    @property
    def own_shape(self) -> Floats:
        """Positions of all vertices on the print's mesh, (n, 3), in m (collective)."""
        assert self.printed.evaluation is not None
        return self.problem.physics.shape_of(self.printed.evaluation.equilibrium)

    def compared_with(self, pattern: Pattern, beyond: Floats) -> LinePrint:
        """Return it with what a finer mesh has told of a similar print on another mesh."""
        if self.printed.failure:
            return self
        there = make_transfer(pattern, self.case.pattern).at_vertices(beyond)
        return replace(self, beyond=there)


def print_of_lines(
    job: Job,
    level: Level,
    case: Case,
    laid: LaidLines,
    near: Shape,
    pressures: Sequence[float] | None,
    *,
    alike: bool = False,
) -> LinePrint:
    """Print lines, and simulate this print on a mesh along their borders (collective).

    Args:
        level, case: The mesh of the fabric, and the case on it.
        near: The shape that its simulation starts from.
        pressures: Pressure of each chamber in Pa; None takes those of the case.
        alike: Whether this shape is that of a print that is much the same. If not, the print is
            simulated on coarser meshes first, where steps from a far start are cheap.
    """
    part, printer = case.pattern, job.scene.print

    def cleaning() -> tuple[CleanedRegions, Regions]:
        panels = panels_of(part, case.whole)
        found = panels.whole(regions_on(laid.pattern, laid.regions, part))
        cleaned = clean(panels, found, printer.limits, printer.island_area)
        return cleaned, part_regions(part, cleaned.regions)

    cleaned, regions = on_first_rank(job.comm, cleaning)
    try:
        fine = case.following(job.comm, regions)
    except PatternError as caught:  # raised by all ranks or by none
        problem = job.problem(case, level)
        made = unmeshed(problem, cleaned, printer.limits, str(caught))
        return LinePrint(case, regions, problem, made)
    problem = job.problem(fine, level)

    simulated = SimulatedPrint(near, (case.whole.pattern, cleaned.regions), pressures)

    def start() -> Shape:
        return near if alike else near_on_coarser(job, level, simulated)

    made = printed(
        problem,
        lambda: cleaned,
        printer.limits,
        near=start,
        pressure=pressures,
        journal=job.journal,
    )
    return LinePrint(fine, regions, problem, made)
