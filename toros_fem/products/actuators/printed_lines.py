"""Printed lines on a mesh along their borders, and smooth changes of them that mend the print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from toros_fem.base.errors import PatternError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Floats
from toros_fem.design.lines.laid_lines import (
    LaidLines,
    LineChange,
    PrintBorders,
    SmoothChanges,
    change_between,
    changed,
    print_borders,
    smooth_fields,
    smooth_functions,
)
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.miss import Residuals
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed import PrintedDesign, Shape, printed, unmeshed
from toros_fem.making.cleaning import CleanedRegions, clean, panels_of
from toros_fem.making.printability import part_regions, regions_on
from toros_fem.meshes.panels import border_motion
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.estimates import Job, SimulatedPrint, near_on_coarser

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import Level

# Number of smooth functions by which the widths of each family change, and of smooth warps.
FUNCTIONS, FIELDS = 12, 24
# Largest relative change of a width in one step, and largest way of a line over the square root of
# the area of the lines: the rates tell what a print does up to there.
WIDER, FARTHER = 0.3, 0.04
# Ridges of the least squares that are tried, over the largest singular value.
RIDGES = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3, 0.5)
# The largest ridge counts that promises this part of the largest decrease: rates hold for small
# changes, and what is left near the target is of the size of the mesh's error.
PART = 0.9
# A step that promises to take away less of the residuals than this fraction is not worth a print.
WORTH = 0.2


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


@dataclass(frozen=True, eq=False)
class Mending:
    """A change of earlier lines, and what it promises.

    Attributes:
        before: Size of the residuals of their print.
        promised: The same after the change, by its derivatives.
        whole: Whether the change was not halved.
    """

    lines: LaidLines
    change: LineChange
    before: float
    promised: float
    whole: bool = True

    @property
    def halved(self) -> Mending:
        """Half of the change."""
        between = (self.before + self.promised) / 2
        return Mending(self.lines, self.change.scaled(0.5), self.before, between, whole=False)


def mending(made: LinePrint, lines: LaidLines, residuals: Residuals) -> Mending | None:
    """Return the smooth change of lines that promises most for their print (collective).

    A Gauss–Newton step with a ridge: residuals are linear in the widths of the families and in a
    warp of all lines, by a solve with the print's tangent for each smooth function. None where
    this does not promise a fair part.
    """
    problem, evaluation, mesh = made.problem, made.printed.evaluation, lines.mesh
    if not mesh.size or evaluation is None:
        return None
    comm, pattern, far = problem.comm, problem.skin.pattern, farthest(lines)
    printed = problem.skin.gather_cells(evaluation.projected) > 0.5

    def basis() -> tuple[SmoothChanges, PrintBorders]:
        fields = smooth_fields(mesh, FIELDS, lines.planes)
        changes = SmoothChanges(
            len(lines.families), smooth_functions(mesh, FUNCTIONS), fields, (WIDER, far)
        )
        under = [regions_on(lines.pattern, family.under, pattern) for family in lines.families]
        normals = border_motion(pattern, printed, 1e-3 * far)
        return changes, print_borders(lines, pattern, under, printed, normals)

    changes, borders = on_first_rank(comm, basis)
    before = residuals(made.shape[1])

    def rates(found: list[LineChange]) -> Floats:
        moves = [borders.moves(change) for change in found]
        return problem.shape_derivatives(evaluation, moves, residuals)

    whole = changes.change(_amounts(changes, rates(list(changes.each())), before, far))
    # What bounds leave of the change.
    change = on_first_rank(comm, lambda: change_between(lines, changed(lines, whole, draw=False)))
    promised = before + rates([change])[:, 0]
    sizes = float(np.linalg.norm(before)), float(np.linalg.norm(promised))
    if sizes[1] > (1 - WORTH) * sizes[0]:
        return None
    return Mending(lines, change, *sizes)


def farthest(lines: LaidLines) -> float:
    """Return the largest way of a line in one step, in m."""
    return FARTHER * float(np.sqrt(lines.mesh.areas.sum()))


def _amounts(changes: SmoothChanges, slope: Floats, before: Floats, far: float) -> Floats:
    """Return amounts of the changes by which residuals with these rates become small."""
    left, size, right = np.linalg.svd(slope, full_matrices=False)
    tried: list[Floats] = []
    for ridge in RIDGES:
        part = size / (size**2 + (ridge * size[0]) ** 2)
        amounts = -right.T @ (part * (left.T @ before))
        change = changes.change(amounts)
        wide = float(np.abs(change.widths).max(initial=0.0)) / np.log1p(WIDER)
        way = float(np.abs(change.warp).max(initial=0.0)) / far
        tried.append(amounts / max(1.0, wide, way))
    less = [np.linalg.norm(before) - np.linalg.norm(before + slope @ each) for each in tried]
    return next(
        a for a, won in zip(tried[::-1], less[::-1], strict=True) if won >= PART * max(less)
    )
