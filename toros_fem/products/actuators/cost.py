"""Cost of a run before it begins: triangles, memory, and for `--final` the time."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mpi4py import MPI

from toros_fem.base.errors import MeshSizeError
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.making.layout import placing_fault
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.triangles import (
    expected_triangles,
    lowered_limit,
    require_affordable,
    require_fewer,
)
from toros_fem.products.common.plausibility import target_doubts

if TYPE_CHECKING:  # a scene checks its cost before it is designed
    from toros_fem.products.actuators.scene import DesignScene, Level

log = logging.getLogger(__name__)

# Memory in bytes, measured on designs of 1.5 to 73 thousand simulated triangles: of a rank with all
# libraries, and for each triangle of a design and of a refined mesh.
OF_RANK, OF_TRIANGLE, OF_REFINED = 0.2 * 2**30, 34e3, 28e3
# A Newton step by the number n of triangles, in arbitrary units: Python, what grows with n, and
# the factorisation, which grows with n^1.43 (docs/performance.md).
FIXED, LINEAR, FACTOR, POWER = 5e-3, 3.3e-6, 0.147 / 12e3**1.43, 1.43
# Newton steps on the finest mesh that take as long as a design from one seed with its print and
# curve, fewest and most; and as a point of a trial in contact.
DESIGN, TRIAL_POINT = (300, 2000), (100, 250)
# The probe's mesh is finer by this factor than the coarsest useful one.
PROBE_FINER, PROBE_STEPS = 2.0, 2
# Triangles of a mesh that is made at once.
QUICK = 50_000


@dataclass(frozen=True)
class Cost:
    """Cost of a run.

    Attributes:
        triangles: Expected triangles of the finest mesh of the design or of its print.
        largest: Those of the largest mesh at all, that of a check for instance.
        unknowns: Unknowns of an equilibrium on the finest mesh.
        ranks: Number of ranks.
        beside: Number of prints that are kept beside the largest mesh, which is that of a check.
        placing: Why the panels fit on no bed of the default size, so that the design has no machine
            files; None if they fit, or if that is not known.
        doubts: What is doubtful about the target, as of `target_doubts`.
        poses: Number of poses, each of which has a solver.
    """

    triangles: int
    largest: int
    unknowns: int
    ranks: int
    beside: int = 0
    placing: str | None = None
    doubts: Sequence[str] = ()
    poses: int = 1

    @property
    def memory(self) -> float:
        """Bytes of all ranks together, to about a quarter."""
        own, largest = (
            self.poses * bytes_each * count
            for bytes_each, count in ((OF_TRIANGLE, self.triangles), (OF_REFINED, self.largest))
        )
        work = self.beside * own + largest if self.beside else max(own, largest)
        return self.ranks * OF_RANK + work * (1.2 if self.ranks > 1 else 1.0)


def actuator_cost(comm: MPI.Comm, scene: DesignScene, *, from_print: bool = False) -> Cost:
    """Return the expected cost of a design (collective).

    `from_print` says whether the densities start from a given print.

    Raises:
        MeshSizeError: A mesh would have more triangles than the limit.
    """
    scene = scene.from_print() if from_print else scene
    area, made = sized(comm, scene, probe_level(scene))
    placing, doubtful = None, list[str]()
    if made is not None:
        doubtful = target_doubts(made)
        scene.require_possible(made.pattern)
        whole = made.whole.pattern
        placing = on_first_rank(comm, lambda: placing_fault(whole))
    finest = finest_triangles(scene, area, made)
    largest = _largest_triangles(scene, finest)
    beside = 0
    if largest > finest:
        # Where lines are laid, it may judge another print before, and may take that one.
        lines = scene.design.start == "relaxed" and not from_print
        beside = 2 if lines and scene.design.corrections else 1
    unknowns = round(_unknowns(made) * finest)
    poses = 1 if made is None else 1 + len(made.poses)
    return Cost(finest, largest, unknowns, comm.size, beside, placing, doubtful, poses)


def expected_time(comm: MPI.Comm, scene: DesignScene, cost: Cost) -> tuple[float, float]:
    """Return the least and the largest likely time of a design in s (collective).

    A few steps on a coarse mesh tell how fast this machine is.

    Raises:
        NoEquilibriumError: Their start has no equilibrium.
    """
    level = probe_level(scene)
    problem = scene.problem(comm, scene.case_of_poses(comm, level), level)
    begin = time.perf_counter()
    result = optimize(problem, DesignOptions((Stage(PROBE_STEPS),)), seed=scene.design.seed)
    seconds = comm.bcast(time.perf_counter() - begin)
    steps = sum(row.newton_steps for row in result.history)
    step = seconds / steps * _weight(cost.triangles) / _weight(len(problem.skin.pattern.panel))
    points, _ = scene.trial_size
    fewest, most = (design + points * of for design, of in zip(DESIGN, TRIAL_POINT, strict=True))
    return step * fewest, step * most * scene.design.seeds


def probe_level(scene: DesignScene) -> Level:
    """Return a mesh that is coarse enough for a probe: the design's own where that is, or given."""
    edge, longest = scene.edge_length, scene.coarsest_edge
    if edge is None or longest is None:
        return scene.levels[0]
    return scene.finest_level.scaled(max(1.0, longest / PROBE_FINER / edge))


def sized(comm: MPI.Comm, scene: DesignScene, level: Level) -> tuple[float, Case | None]:
    """Return the area of a skin in m², and its case on a level (collective).

    The case is None where even this mesh has too many triangles for a quick look. No mesh of the
    design and of its check is too fine.

    Raises:
        MeshSizeError: A mesh would have more triangles than `triangle_limit` allows.
    """
    made = None
    try:
        with lowered_limit(QUICK):
            made = scene.case_of_poses(comm, level)
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


def require_affordable_meshes(comm: MPI.Comm, scene: DesignScene) -> Case | None:
    """Check all meshes of a design by the coarsest one, and return its case (collective).

    The case is None where even this mesh has too many triangles for a quick look.

    Raises:
        MeshSizeError: One would have more triangles than `triangle_limit` allows.
    """
    lines = scene.design.start == "relaxed"
    area, made = sized(comm, scene, scene.relaxed_level if lines else scene.levels[0])
    if comm.rank == 0 and (scene.edges or scene.results.check_refinement is not None):
        count = finest_triangles(scene, area, made)
        log.info("about %d triangles on the finest mesh", count)
    return made


def finest_triangles(scene: DesignScene, area: float, made: Case | None) -> int:
    """Return the triangles of the finest mesh, from what `sized` has found."""
    if edges := scene.edges:
        return round(expected_triangles(area, min(edges.values())))
    return 0 if made is None else round(len(made.pattern.panel) * 4.0 ** (scene.level_count - 1))


def _largest_triangles(scene: DesignScene, finest: int) -> int:
    """Return the triangles of the finer mesh of the check, or those of the finest without one."""
    checked = scene.checked(scene.finest_level)
    return finest if checked is None else round(finest / checked[0] ** 2)


def _unknowns(made: Case | None) -> float:
    """Return coordinates of vertices and, for "midedge", rotations of edges for each triangle."""
    # A closed surface has half as many vertices as triangles, and three edges for two of them.
    if made is None:
        return 3 * 0.5 + 1.5
    of, bending = made.pattern, (made.composite or Composite()).bending
    turned = bending is not None and bending.curvature == "midedge"
    return (3 * len(of.points) + turned * len(of.edges.ends)) / len(of.panel)


def _weight(triangles: float) -> float:
    return FIXED + LINEAR * triangles + FACTOR * triangles**POWER
