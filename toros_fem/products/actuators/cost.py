"""Cost of an actuator's design before it runs: triangles, memory, and time from a short probe."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mpi4py import MPI

from toros_fem.base.errors import MeshSizeError
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.meshes.triangle_limit import expected_triangles, lowered_limit, require_affordable
from toros_fem.products.actuators.pressure_curve import HALVINGS

if TYPE_CHECKING:  # a scene checks its cost before it is designed
    from toros_fem.products.actuators.scene import ActuatorScene, Level

log = logging.getLogger(__name__)

# Memory in bytes, measured on designs of 1.5 to 73 thousand simulated triangles: of a rank with all
# libraries, and for each triangle of a design and of the refined mesh of the error estimate.
OF_RANK, OF_TRIANGLE, OF_REFINED = 0.2 * 2**30, 34e3, 28e3
# A Newton step by the number n of triangles, in arbitrary units: Python, what grows with n, and
# the factorisation, which grows with n^1.43 (docs/performance.md).
FIXED, LINEAR, FACTOR, POWER = 5e-3, 3.3e-6, 0.147 / 12e3**1.43, 1.43
# Newton steps of each part, fewest and most, as counted in runs of the scenes.
DESIGN_STEP, PRINT, LINE_PRINT, CURVE_POINT, REFINED = (
    (6, 10),
    (10, 40),
    (40, 130),
    (6, 20),
    (8, 20),
)
# Cleaning, drawing and laying of lines take as long as so many Newton steps.
CLEANING, LAYING = 10, (6, 15)
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
        name: What it is.
        triangles: Triangles of its mesh.
        newton_steps: Fewest and most Newton steps that are likely.
    """

    name: str
    triangles: int
    newton_steps: tuple[int, int]


@dataclass(frozen=True)
class Cost:
    """Cost of a run.

    Attributes:
        triangles: Expected triangles of the finest mesh of the design or of its print.
        largest: Those of the largest mesh at all, that of the error estimate for instance.
        unknowns: Unknowns of an equilibrium on the finest mesh.
        memory: Bytes of all ranks together, to about a quarter.
        parts: Parts of the run that take time.
    """

    triangles: int
    largest: int
    unknowns: int
    memory: float
    parts: tuple[Part, ...]

    def seconds(self, per_step: float, triangles: int) -> tuple[float, float]:
        """Return the least and the largest likely time in s.

        Args:
            per_step: Time in s of a Newton step of the probe.
            triangles: Triangles of the probe's mesh.
        """
        unit = per_step / _weight(triangles)
        low, high = AROUND
        for part in self.parts:
            weight = unit * _weight(part.triangles)
            low += weight * part.newton_steps[0]
            high += weight * part.newton_steps[1]
        return low, high


@dataclass(frozen=True)
class Probe:
    """A few real design steps on a mesh.

    Attributes:
        triangles: Triangles of the mesh.
        newton_steps: Newton steps that were made.
        seconds: Time of these, with adjoints and updates of the design, in s.
    """

    triangles: int
    newton_steps: int
    seconds: float

    @property
    def per_step(self) -> float:
        """Time of a Newton step in s."""
        return self.seconds / self.newton_steps


def probe_level(scene: ActuatorScene) -> Level:
    """Return a mesh that is coarse enough for a probe.

    It is the design's own mesh where that is coarse, or given.
    """
    edge, longest = scene.edge_length, scene.coarsest_edge
    if edge is None or longest is None:
        return scene.levels[0]
    return scene.finest_level.scaled(max(1.0, longest / PROBE_FINER / edge))


def probe(comm: MPI.Comm, scene: ActuatorScene, made: Case) -> Probe:
    """Make a few steps of a design from noise and take their time (collective).

    Args:
        comm: Communicator.
        scene: What is designed.
        made: Its case on the mesh of `probe_level`.

    Raises:
        NoEquilibriumError: The start has no equilibrium.
    """
    problem = scene.problem(comm, made, probe_level(scene))
    return probe_problem(problem, len(made.pattern.panel), scene.design.seed)


def probe_problem(problem: DesignProblem, triangles: int, seed: int) -> Probe:
    """Make a few steps of a design from noise and take their time (collective).

    Args:
        problem: The problem.
        triangles: Triangles of its mesh.
        seed: Seed of the start.

    Raises:
        NoEquilibriumError: The start has no equilibrium.
    """
    begin = time.perf_counter()
    result = optimize(problem, DesignOptions((Stage(PROBE_STEPS),)), seed=seed)
    seconds = problem.comm.bcast(time.perf_counter() - begin)
    return Probe(triangles, sum(row.newton_steps for row in result.history), seconds)


def simple_cost(
    triangles: int, largest: int, unknowns: int, ranks: int, parts: tuple[Part, ...]
) -> Cost:
    """Return the cost of a run from its meshes and parts.

    Args:
        triangles: Triangles of the finest mesh of the design.
        largest: Those of the largest mesh that is simulated.
        unknowns: Unknowns of an equilibrium on the finest mesh.
        ranks: Number of ranks.
        parts: Its parts.
    """
    work = max(OF_TRIANGLE * triangles, OF_REFINED * largest)
    memory = ranks * OF_RANK + work * (1.2 if ranks > 1 else 1.0)
    return Cost(triangles, largest, unknowns, memory, parts)


def cost(config: ActuatorScene, made: Sized, ranks: int) -> Cost:
    """Return the expected cost of a design.

    Args:
        config: What is designed.
        made: Area, and the mesh of `probe_level`, by `sized`.
        ranks: Number of ranks.
    """
    area, count = made.area, made.triangles
    finest = _finest_triangles(config, made)
    lines = config.design.start == "relaxed"
    largest = 4 * finest if config.results.estimate_error and not lines else finest
    if lines:
        parts = _line_parts(config, area, count, finest)
    else:
        parts = _density_parts(config, finest, ranks)
    return simple_cost(finest, largest, round(_unknowns(config, made) * finest), ranks, parts)


@dataclass(frozen=True, eq=False)
class Sized:
    """Area of a skin, before its finest mesh is made.

    Attributes:
        area: Area in m².
        triangles: Triangles of the given mesh; 0 where it is not made.
        case: The case on that mesh; None where even this has too many triangles for a quick look.
    """

    area: float
    triangles: int
    case: Case | None


def sized(comm: MPI.Comm, scene: ActuatorScene, level: Level) -> Sized:
    """Return the area of a skin, and check that no mesh of its design is too fine (collective).

    Args:
        comm: Communicator.
        scene: What is designed.
        level: A mesh that is made, if it is not too large for a quick look.

    Raises:
        MeshSizeError: A mesh would have more triangles than `triangle_limit` allows.
    """
    try:
        with lowered_limit(QUICK):
            made = scene.case(comm, level)
    except MeshSizeError as error:  # raised by all ranks
        found = Sized(error.area, 0, None)
    else:
        found = Sized(float(made.pattern.areas.sum()), len(made.pattern.panel), made)
    for edge in _edges(scene):
        require_affordable(found.area, edge)
    return found


def require_affordable_meshes(comm: MPI.Comm, scene: ActuatorScene) -> None:
    """Check all meshes of a design by the area of the coarsest one (collective).

    Raises:
        MeshSizeError: One would have more triangles than `triangle_limit` allows.
    """
    if not _edges(scene):
        return
    lines = scene.design.start == "relaxed"
    first = sized(comm, scene, scene.relaxed_level if lines else scene.levels[0])
    if comm.rank == 0:
        log.info("about %d triangles on the finest mesh", _finest_triangles(scene, first))


def _edges(scene: ActuatorScene) -> Sequence[float]:
    """Return the edge lengths of the finest meshes of a design; none where the mesh is given."""
    edge = scene.edge_length
    if edge is None:
        return ()
    if scene.design.start == "relaxed":
        return (scene.lines.relaxed_edge_length, scene.lines.print_edge_length)
    return (edge,)


def _finest_triangles(config: ActuatorScene, made: Sized) -> int:
    edges = _edges(config)
    if edges:
        return round(expected_triangles(made.area, min(edges)))
    return round(made.triangles * 4.0 ** (config.level_count - 1))


def _unknowns(config: ActuatorScene, made: Sized) -> float:
    """Return coordinates of vertices and, for "midedge", rotations of edges for each triangle."""
    # A closed surface has half as many vertices as triangles, and three edges for two of them.
    points, edges = 0.5, 1.5
    if made.case is not None:
        pattern = made.case.pattern
        points, edges = (len(x) / made.triangles for x in (pattern.points, pattern.edges.ends))
    return 3 * points + (edges if config.material.bending == "midedge" else 0.0)


def _density_parts(config: ActuatorScene, finest: int, ranks: int) -> tuple[Part, ...]:
    """Return the parts of a design by densities; each mesh has a quarter of the next one."""
    parts, levels = [], config.level_count
    for level, options in enumerate(config.options):
        steps = sum(stage.iterations + 1 for stage in options.stages)
        if level == 0:
            steps *= math.ceil(config.design.starts / ranks)  # each rank tries its own
        triangles = round(finest / 4.0 ** (levels - 1 - level))
        most = steps + config.design.polish_iterations
        parts.append(
            Part(
                f"design, mesh {level + 1} of {levels}",
                triangles,
                (DESIGN_STEP[0] * steps, DESIGN_STEP[1] * most),
            )
        )
    rounds = config.design.corrections if config.targets() else 0
    more = config.design.level_iterations + 1
    if rounds:
        likely = (DESIGN_STEP[0] * more, DESIGN_STEP[1] * more * rounds)
        parts.append(Part(f"corrections, {rounds} at most", finest, likely))
    least = PRINT[0] + CLEANING
    parts.append(
        Part("prints", finest, (least * levels, (PRINT[1] + CLEANING) * (levels + rounds)))
    )
    if config.results.estimate_error:
        parts.append(Part("estimate of the error", 4 * finest, REFINED))
    return (*parts, *_curve_part(config, finest))


def _line_parts(config: ActuatorScene, area: float, count: int, finest: int) -> tuple[Part, ...]:
    """Return the parts of a relaxed design and of the prints of its lines."""
    given = not _edges(config)
    relaxed = count if given else round(expected_triangles(area, config.lines.relaxed_edge_length))
    rounds, more = config.design.corrections, config.relaxed_options.more_iterations
    steps, most = (
        config.lines.relaxed_iterations,
        2 * config.lines.relaxed_iterations + rounds * more,
    )
    least = 1 + rounds // 2  # the last ones are left out where a print is close
    parts = [
        Part("relaxed design", relaxed, (3 * steps, DESIGN_STEP[1] * most)),
        Part("laying of lines", finest, (LAYING[0] * least, LAYING[1] * (1 + rounds))),
        Part(
            f"prints of lines, {1 + rounds} at most",
            finest,
            (LINE_PRINT[0] * least, LINE_PRINT[1] * (1 + rounds)),
        ),
    ]
    if config.lines.density_iterations:
        own = config.lines.density_iterations + rounds * (config.design.level_iterations + 1)
        likely = (DESIGN_STEP[0] * config.lines.density_iterations, DESIGN_STEP[1] * own)
        parts.append(Part("densities from lines", finest, likely))
    if config.results.estimate_error:
        parts.append(Part("estimate of the error", finest // 2, LINE_PRINT))
    return (*parts, *_curve_part(config, finest))


def _curve_part(config: ActuatorScene, finest: int) -> tuple[Part, ...]:
    if config.results.curve_pressure is None:
        return ()
    points = config.results.curve_steps, config.results.curve_steps + HALVINGS
    likely = CURVE_POINT[0] * points[0], CURVE_POINT[1] * points[1]
    return (Part("curve over the pressure", finest, likely),)


def _weight(triangles: float) -> float:
    return FIXED + LINEAR * triangles + FACTOR * triangles**POWER
