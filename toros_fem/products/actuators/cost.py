"""Cost of a run before it begins: triangles, memory, and time from a short probe."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mpi4py import MPI

from toros_fem.base.errors import MeshSizeError
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.making.sheets.layout import placing_fault
from toros_fem.meshes.triangles import (
    expected_triangles,
    lowered_limit,
    require_affordable,
    require_fewer,
)
from toros_fem.products.actuators.estimates import COARSER
from toros_fem.products.actuators.other_mesh import COARSER_MESHES
from toros_fem.products.actuators.pressure_curve import HALVINGS, PARTS

if TYPE_CHECKING:  # a scene checks its cost before it is designed
    from toros_fem.products.actuators.scene import ActuatorScene, Level

log = logging.getLogger(__name__)

# Memory in bytes, measured on designs of 1.5 to 73 thousand simulated triangles: of a rank with all
# libraries, and for each triangle of a design and of a refined mesh.
OF_RANK, OF_TRIANGLE, OF_REFINED = 0.2 * 2**30, 34e3, 28e3
# A Newton step by the number n of triangles, in arbitrary units: Python, what grows with n, and
# the factorisation, which grows with n^1.43 (docs/performance.md).
FIXED, LINEAR, FACTOR, POWER = 5e-3, 3.3e-6, 0.147 / 12e3**1.43, 1.43
# Newton steps, fewest and most, as counted in runs of the scenes: of a design step, of a print with
# its cleaning, of a print of lines, and of a point of the curve.
DESIGN_STEP, PRINT, LINE_PRINT = (6, 10), (20, 50), (40, 130)
CURVE_POINT = (6, 20)
# Those of an equilibrium on the ground, and the cost of one with contact and friction.
TRIAL_POINT, IN_CONTACT = (20, 50), 5.0
# Laying of lines takes as long as so many Newton steps.
LAYING = (6, 15)
# The probe's mesh is finer by this factor than the coarsest useful one.
PROBE_FINER = 2.0
# Triangles of a mesh that is made at once.
QUICK = 50_000
PROBE_STEPS = 2
# Part of a design that is no Newton step: reading, set-ups, pictures; in s.
AROUND = (5.0, 20.0)


@dataclass(frozen=True)
class Part:
    """A part of a run.

    Attributes:
        triangles: Those of its mesh.
        newton_steps: Fewest and most that are likely.
        dearer: Cost of a step over one without contact.
    """

    name: str
    triangles: int
    newton_steps: tuple[int, int]
    dearer: float = 1.0


@dataclass(frozen=True)
class Probe:
    """A few Newton steps on a mesh, and their time in s with adjoints and updates of the design."""

    triangles: int
    newton_steps: int
    seconds: float

    @property
    def per_step(self) -> float:
        """Time of a Newton step in s."""
        return self.seconds / self.newton_steps


@dataclass(frozen=True)
class Cost:
    """Cost of a run.

    Attributes:
        triangles: Expected triangles of the finest mesh of the design or of its print.
        largest: Those of the largest mesh at all, that of a tile's print for instance.
        unknowns: Unknowns of an equilibrium on the finest mesh.
        ranks: Number of ranks.
        parts: Parts of the run that take time.
        probe: What the time is known from; None leaves it unknown.
        beside: Number of prints that are kept beside the largest mesh, which is that of a check.
        placing: Why the panels fit on no bed of the default size, so that the design has no machine
            files; None if they fit, or if that is not known.
    """

    triangles: int
    largest: int
    unknowns: int
    ranks: int
    parts: Sequence[Part]
    probe: Probe | None = None
    beside: int = 0
    placing: str | None = None

    @property
    def memory(self) -> float:
        """Bytes of all ranks together, to about a quarter."""
        own, largest = OF_TRIANGLE * self.triangles, OF_REFINED * self.largest
        work = self.beside * own + largest if self.beside else max(own, largest)
        return self.ranks * OF_RANK + work * (1.2 if self.ranks > 1 else 1.0)

    @property
    def seconds(self) -> tuple[float, float] | None:
        """The least and the largest likely time in s."""
        if self.probe is None:
            return None
        unit = self.probe.per_step / _weight(self.probe.triangles)
        low, high = AROUND
        for part in self.parts:
            weight = unit * part.dearer * _weight(part.triangles)
            low += weight * part.newton_steps[0]
            high += weight * part.newton_steps[1]
        return low, high


def probe(problem: DesignProblem, seed: int) -> Probe:
    """Make a few steps of a design from noise and take their time (collective).

    Raises:
        NoEquilibriumError: The start has no equilibrium.
    """
    begin = time.perf_counter()
    result = optimize(problem, DesignOptions((Stage(PROBE_STEPS),)), seed=seed)
    seconds = problem.comm.bcast(time.perf_counter() - begin)
    steps = sum(row.newton_steps for row in result.history)
    return Probe(len(problem.skin.pattern.panel), steps, seconds)


def actuator_cost(
    comm: MPI.Comm, scene: ActuatorScene, *, probing: bool, from_print: bool = False
) -> Cost:
    """Return the expected cost of a design (collective).

    `probing` says whether to try some steps on a coarse mesh. What is too large for a quick look is
    too large for that. `from_print` says whether the densities start from a given print.

    Raises:
        MeshSizeError: A mesh would have more triangles than the limit.
    """
    scene = scene.from_print() if from_print else scene
    level = probe_level(scene)
    area, made = sized(comm, scene, level)
    tried = placing = None
    if made is not None:
        scene.require_possible(made.pattern)
        whole = made.whole.pattern
        placing = on_first_rank(comm, lambda: placing_fault(whole))
        if probing:
            tried = probe(scene.problem(comm, made, level), scene.design.seed)
    finest, results = finest_triangles(scene, area, made), scene.results
    if from_print:
        parts = _density_parts(scene.updated(starts=1), finest, [scene.print_options], comm.size)
    elif scene.design.start == "relaxed":
        relaxed = 0 if made is None else len(made.pattern.panel)
        if scene.edges:
            relaxed = round(expected_triangles(area, scene.lines.relaxed_edge_length))
        parts = _line_parts(scene, relaxed, finest)
    else:
        parts = _density_parts(scene, finest, scene.options, comm.size)
    if results.estimate_error:
        for k in range(1, COARSER_MESHES + 1):
            name = f"estimate of the error, mesh {k} of {COARSER_MESHES}"
            parts.append(Part(name, round(finest / COARSER ** (2 * k)), LINE_PRINT))
    largest = _largest_triangles(scene, finest)
    beside = 0
    if largest > finest:
        # Where lines are laid, it may judge another print before, and may take that one.
        lines = scene.design.start == "relaxed" and not from_print
        beside = 2 if lines and scene.design.corrections else 1
        likely = _times(CURVE_POINT, 1, beside)
        parts.append(Part("estimate of the error, finer mesh", largest, likely))
    seeds = scene.design.seeds
    if seeds > 1 and not from_print:
        parts = [replace(part, newton_steps=_times(part.newton_steps, 1, seeds)) for part in parts]
    if results.curve_pressure is not None:
        most = results.curve_steps + HALVINGS + PARTS
        likely = _times(CURVE_POINT, results.curve_steps, most)
        parts.append(Part("curve over the pressure", finest, likely))
    parts += _trial_parts(scene, finest)
    unknowns = round(_unknowns(scene, made) * finest)
    return Cost(finest, largest, unknowns, comm.size, parts, tried, beside, placing)


def probe_level(scene: ActuatorScene) -> Level:
    """Return a mesh that is coarse enough for a probe: the design's own where that is, or given."""
    edge, longest = scene.edge_length, scene.coarsest_edge
    if edge is None or longest is None:
        return scene.levels[0]
    return scene.finest_level.scaled(max(1.0, longest / PROBE_FINER / edge))


def sized(comm: MPI.Comm, scene: ActuatorScene, level: Level) -> tuple[float, Case | None]:
    """Return the area of a skin in m², and its case on a level (collective).

    The case is None where even this mesh has too many triangles for a quick look. No mesh of the
    design and of its check is too fine.

    Raises:
        MeshSizeError: A mesh would have more triangles than `triangle_limit` allows.
    """
    made = None
    try:
        with lowered_limit(QUICK):
            made = scene.case(comm, level)
        area = float(made.pattern.areas.sum())
    except MeshSizeError as error:  # raised by all ranks
        area = error.area
    for key, edge in scene.edges.items():
        require_affordable(area, edge, key)
    finest = finest_triangles(scene, area, made)
    largest = _largest_triangles(scene, finest)
    if largest > finest:
        require_fewer(largest, area, "Take a smaller check_refinement", "check_refinement")
    return area, made


def require_affordable_meshes(comm: MPI.Comm, scene: ActuatorScene) -> None:
    """Check all meshes of a design by the area of the coarsest one (collective).

    Raises:
        MeshSizeError: One would have more triangles than `triangle_limit` allows.
    """
    if not scene.edges and scene.results.check_refinement is None:
        return
    lines = scene.design.start == "relaxed"
    area, made = sized(comm, scene, scene.relaxed_level if lines else scene.levels[0])
    if comm.rank == 0:
        count = finest_triangles(scene, area, made)
        log.info("about %d triangles on the finest mesh", count)


def finest_triangles(scene: ActuatorScene, area: float, made: Case | None) -> int:
    """Return the triangles of the finest mesh, from what `sized` has found."""
    if edges := scene.edges:
        return round(expected_triangles(area, min(edges.values())))
    return 0 if made is None else round(len(made.pattern.panel) * 4.0 ** (scene.level_count - 1))


def _largest_triangles(scene: ActuatorScene, finest: int) -> int:
    """Return the triangles of the finer mesh of the check, or those of the finest without one."""
    checked = scene.checked(scene.finest_level)
    return finest if checked is None else round(finest / checked[0] ** 2)


def _unknowns(scene: ActuatorScene, made: Case | None) -> float:
    """Return coordinates of vertices and, for "midedge", rotations of edges for each triangle."""
    # A closed surface has half as many vertices as triangles, and three edges for two of them.
    points, edges = 0.5, 1.5
    if made is not None:
        of, count = made.pattern, len(made.pattern.panel)
        points, edges = len(of.points) / count, len(of.edges.ends) / count
    return 3 * points + (edges if scene.material.bending == "midedge" else 0.0)


def _times(steps: tuple[int, int], fewest: int, most: int) -> tuple[int, int]:
    return steps[0] * fewest, steps[1] * most


def _density_parts(
    scene: ActuatorScene, finest: int, options: Sequence[DesignOptions], ranks: int
) -> list[Part]:
    """Return the parts of a design by densities; each mesh has a quarter of the next one."""
    design, parts, levels = scene.design, list[Part](), len(options)
    for level, own in enumerate(options):
        steps = sum(stage.iterations + 1 for stage in own.stages)
        if level == 0:
            steps *= math.ceil(design.starts / ranks)  # each rank tries its own
        likely = _times(DESIGN_STEP, steps, steps + design.polish_iterations)
        triangles = round(finest / 4.0 ** (levels - 1 - level))
        parts.append(Part(f"design, mesh {level + 1} of {levels}", triangles, likely))
    rounds, more = design.corrections, design.level_iterations + 1
    if rounds:
        likely = _times(DESIGN_STEP, more, more * rounds)
        parts.append(Part(f"corrections, {rounds} at most", finest, likely))
    return [*parts, Part("prints", finest, _times(PRINT, levels, levels + rounds))]


def _line_parts(scene: ActuatorScene, relaxed: int, finest: int) -> list[Part]:
    """Return the parts of a relaxed design and of the prints of its lines."""
    lines, rounds = scene.lines, scene.design.corrections
    most = 2 * lines.relaxed_iterations + rounds * scene.relaxed_options.more_iterations
    least = 1 + rounds // 2  # the last ones are left out where a print is close
    prints = f"prints of lines, {1 + rounds} at most"
    parts = [
        Part("relaxed design", relaxed, (3 * lines.relaxed_iterations, DESIGN_STEP[1] * most)),
        Part("laying of lines", finest, _times(LAYING, least, 1 + rounds)),
        Part(prints, finest, _times(LINE_PRINT, least, 1 + rounds)),
    ]
    if steps := lines.density_iterations:
        own = steps + rounds * (scene.design.level_iterations + 1)
        parts.append(Part("densities from lines", finest, _times(DESIGN_STEP, steps, own)))
    return parts


def _trial_parts(scene: ActuatorScene, finest: int) -> list[Part]:
    """Return the parts of a scene's trial, and of its repeat on another mesh."""
    points, larger = scene.trial_size
    if points == 0:
        return []
    own, steps = round(larger * finest), _times(TRIAL_POINT, points, points)
    parts = [Part("trial", own, steps, IN_CONTACT)]
    if scene.results.estimate_error:
        other = round(own / scene.TRIAL_MESH**2)
        parts.append(Part("trial on another mesh", other, steps, IN_CONTACT))
    return parts


def _weight(triangles: float) -> float:
    return FIXED + LINEAR * triangles + FACTOR * triangles**POWER
