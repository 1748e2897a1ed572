"""A print on other meshes than its own, and what these tell: half-widths of intervals."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError, PatternError, TorosError
from toros_fem.base.mpi import free_dropped
from toros_fem.base.validation import Floats, require_kind
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import Callback
from toros_fem.design.loop.miss import prefix_of, quantities_of, shape_of
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import Regularisation, ShapeDesign
from toros_fem.making.as_printed import PrintedDesign, Shape, state_near
from toros_fem.making.printability import case_of_print
from toros_fem.measures.figures import Figure
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.readings.error_estimate import edge_of, half_width
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.pressure import trimmed

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import DesignScene, Level

# Number of coarser meshes that a print is simulated on, where there are so many.
COARSER_MESHES = 2
# A pattern and the print on each of its panels, polygons in m.
Printed = tuple[Pattern, Regions]
log = logging.getLogger(__name__)
# Ratio of edge lengths of two meshes whose difference tells an error.
COARSER = 1.5
# Safety factor of trials, whose intervals were not compared with finer meshes.
SAFETY = 1.7
Measures = Mapping[str, Callable[[Pattern, Floats], float]]
# Simulates a print on the mesh of a scene's `TRIAL_MESH`.
OnOtherMesh = Callable[[], Evaluation[Equilibrium]]


@dataclass(frozen=True, eq=False)
class Job:
    """A scene that is designed, and who follows its steps.

    Attributes:
        reporter: Called after each step of the design, on every rank; None reports nothing.
        journal: Keeps the state of the run; None keeps nothing.
        verbose: Whether to print every Newton step.
    """

    comm: MPI.Comm
    scene: DesignScene
    reporter: Callback | None = None
    journal: Journal | None = None
    verbose: bool = False

    def branch(self, name: str) -> Journal | None:
        """Return the branch of its journal for a part of the run; None keeps nothing."""
        return None if self.journal is None else self.journal.branch(name)

    def trimmed(self, printed: PrintedDesign) -> PrintedDesign:
        """Return a print at the pressure that suits it best, or at the one that is held."""
        if self.holds(printed):
            return printed
        return trimmed(printed, tolerances=self.scene.results.tolerances)

    def holds(self, printed: PrintedDesign) -> bool:
        """Return whether the pressure of a print is as it was given."""
        made = printed.evaluation
        if made is None:
            return False
        designed = any(made.problem.physics.pressure_ranges)
        return not designed and (not made.poses or self.scene.holds_pressure)

    def problem(self, case: Case, level: Level) -> ShapeDesign:
        """Return the design problem of a case on the mesh of a level (collective)."""
        return self.scene.problem(self.comm, case, level, verbose=self.verbose)


@dataclass(frozen=True, eq=False)
class SimulatedPrint:
    """What is simulated again, on another mesh.

    Attributes:
        near: The shape that the simulation starts from.
        poses: Positions of its vertices in further poses, (n, 3), in m.
        printed: The print; None for a skin without one.
        pressures: Pressure of each chamber in Pa; None takes those of the scene.
    """

    near: Shape
    printed: Printed | None
    pressures: Sequence[float] | None
    poses: tuple[Floats, ...] = ()

    @classmethod
    def of(cls, printed: PrintedDesign) -> SimulatedPrint:
        """Return a print that has an equilibrium, which is where it starts (collective)."""
        assert printed.evaluation is not None
        made = printed.evaluation
        poses = tuple(_shape(one)[1] for one in made.poses)
        regions = printed.pattern, printed.regions
        return cls(_shape(made), regions, made.equilibrium.pressures, poses)


def simulated_on(
    job: Job, level: Level, simulated: SimulatedPrint, ratio: float
) -> Evaluation[Equilibrium]:
    """Simulate a print on another mesh (collective).

    Args:
        level: The mesh.
        simulated: The print.
        ratio: How much longer its edges are than those of the print's own mesh.

    Raises:
        NoEquilibriumError: There is none.
    """
    case, rules = job.scene.case_of_poses(job.comm, level), level.regularisation
    return simulated_again(job.comm, case, rules, simulated, ratio)


def simulated_again(
    comm: MPI.Comm, case: Case, rules: Regularisation, simulated: SimulatedPrint, ratio: float
) -> Evaluation[Equilibrium]:
    """Simulate a print on the mesh of a case, as `simulated_on` does (collective)."""
    if simulated.printed is not None:
        case = case_of_print(comm, case, *simulated.printed, coarser=ratio)
    problem = ShapeDesign(comm, case, rules.plain)
    start = state_near(problem, *simulated.near, *simulated.poses)
    plain = np.zeros(len(problem.designed))
    return problem.simulate_binary(plain, start=start, pressure=simulated.pressures)


def coarser_levels(scene: DesignScene, level: Level) -> dict[float, Level]:
    """Return coarser meshes, by their edge length over that of a level.

    Raises:
        ParameterError: There is none.
    """
    found: dict[float, Level] = {}
    ratio = 1.0
    for _ in range(COARSER_MESHES):
        try:
            more, level = scene.coarser(level)
        except ParameterError:
            if not found:
                raise
            break
        ratio *= more
        found[ratio] = level
    return found


def near_on_coarser(job: Job, level: Level, simulated: SimulatedPrint) -> Shape:
    """Return the shape of a print on a coarser mesh, or the given one without any (collective).

    The steps from a far start are cheap there. The coarsest mesh comes first.
    """
    others: dict[float, Level] = {}
    with suppress(TorosError):  # raised by all ranks or by none, as below
        others = coarser_levels(job.scene, level)
    for ratio, other in reversed(others.items()):
        with suppress(TorosError):
            simulated = replace(simulated, near=_shape(simulated_on(job, other, simulated, ratio)))
        free_dropped(job.comm)
    return simulated.near


def _shape(made: Evaluation[Equilibrium]) -> Shape:
    skin = made.problem.skin
    return skin.pattern, skin.gather_vertices(made.equilibrium.positions)


@dataclass(frozen=True, eq=False)
class MeshValues:
    """What one mesh tells of a print.

    Attributes:
        pattern, positions: The mesh, and the positions of all of its vertices, (n, 3), in m.
        values: Values by key; a target may be unknown on other meshes.
    """

    pattern: Pattern
    positions: Floats
    values: Mapping[str, float]

    def at_vertices(self, pattern: Pattern) -> Floats:
        """Return the shape at the vertices of another mesh, (n, 3), in m."""
        return make_transfer(self.pattern, pattern).positions(self.positions)


@dataclass(frozen=True, eq=False)
class MetricErrors:
    """What several meshes tell of a print, and how far that may be off.

    Attributes:
        found: What each mesh tells, by its edge length over that of the print's mesh.
        intervals: Half-width of the interval of each value that is told, by key.
        shape: Shape on the finer mesh at the vertices of the print's mesh, (n, 3), in m; None
            without a finer mesh.
        failure: Why there is nothing to compare with; None if there is.
        seconds: Wall time.
    """

    found: Mapping[float, MeshValues] = field(default_factory=dict)
    intervals: Mapping[str, float] = field(default_factory=dict)
    shape: Floats | None = None
    failure: str | None = None
    seconds: float | None = None

    @property
    def told(self) -> dict[str, float]:
        """Values that are told, by key: those of the finest mesh."""
        fine = sorted((ratio for ratio in self.found if ratio <= 1), reverse=True)
        return {key: value for ratio in fine for key, value in self.found[ratio].values.items()}

    def as_dict(self) -> dict[str, Any]:
        """Return it as summaries hold it; the intervals are with the figures."""
        meshes = {ratio: one.values for ratio, one in self.found.items()}
        return {"meshes": meshes, "failure": self.failure, "seconds": self.seconds}

    @property
    def words(self) -> str:
        """Why errors are unknown, or that a finer mesh tells the figures, in words; or empty."""
        if self.failure is not None:
            return "nothing to compare with, so that errors are unknown"
        finest = min(self.found, default=1.0)
        return "" if finest >= 1 else f"figures of a mesh with edges of 1/{1 / finest:g} the length"


def metric_errors(
    job: Job,
    level: Level,
    own: MeshValues,
    simulated: SimulatedPrint,
    whole: Pattern,
    known: Mapping[float, MeshValues] | None = None,
) -> MetricErrors:
    """Return the errors of values of a print, from the same print on other meshes (collective).

    With a finer mesh, by `check_refinement`, its values are told, with its intervals.

    Args:
        job: What was printed.
        level: The mesh of the print.
        own: What this mesh tells.
        simulated: The print, and its shape.
        whole: The whole skin, of which a part may be simulated.
        known: What other meshes tell, as far as this is known.
    """
    begin, scene = time.perf_counter(), job.scene
    keys, found = [*own.values], {1.0: own, **(known or {})}
    failure = None
    try:
        others = coarser_levels(scene, level)
    except ParameterError as caught:  # raised by all ranks or by none, as below
        others, failure = {}, str(caught)
    if (checked := scene.checked(level)) is not None:
        others |= [checked]
    for ratio, other in others.items():
        if ratio in found:
            continue
        try:
            found[ratio] = values_on(job, other, simulated, keys, ratio)
        except TorosError as caught:
            failure = failure or str(caught)
            if ratio < 1 and job.comm.rank == 0:
                log.warning("the check on a finer mesh is left out: %s", caught)
        free_dropped(job.comm)
    finest = min(found)
    shape = None if finest == 1 else found[finest].at_vertices(simulated.near[0])
    intervals = _intervals(found, keys, whole)
    failure = failure if len(found) == 1 else None
    seconds = time.perf_counter() - begin
    return MetricErrors(found, intervals, shape, failure, seconds)


def print_intervals(printed: PrintedDesign, coarser: Mapping[float, Case]) -> dict[str, float]:
    """Return half-widths of the intervals of a print's figures, from coarser meshes (collective).

    The print is simulated on each; one without an equilibrium is left out. Keys are those of
    metrics, and of what the shape misses. `write_results` takes them.

    Args:
        printed: The print; without an equilibrium nothing is known.
        coarser: The same case on coarser meshes, by how much longer their edges are than those of
            the mesh that was designed on: 1.5 and 2.25 are what scenes take.

    Raises:
        ParameterError: An argument has another type, or a mesh is not coarser.
    """
    require_kind("printed", printed, PrintedDesign, "the PrintedDesign of as_printed")
    require_kind("coarser", coarser, Mapping, "cases by their edge length over that of the design")
    for ratio, case in coarser.items():
        require_kind(f"coarser[{ratio}]", case, Case, "a Case")
        if not ratio > 1:
            raise ParameterError(f"coarser has edges {ratio} times as long; they must be longer.")
    made = printed.evaluation
    if made is None:
        return {}
    problem = made.problem
    require_kind("the problem of the print", problem, ShapeDesign, "a ShapeDesign")
    assert isinstance(problem, ShapeDesign)
    rules = problem.regularisation
    simulated, keys = SimulatedPrint.of(printed), [*made.metrics, *shape_of(made)]
    found = {1.0: values_at(made, keys)}
    for ratio, case in coarser.items():
        try:
            there = simulated_again(problem.comm, case, rules.scaled(ratio), simulated, ratio)
            found[ratio] = values_at(there, keys)
        except (NoEquilibriumError, PatternError) as caught:  # raised by all ranks or by none
            if problem.comm.rank == 0:
                log.warning("a coarser mesh is left out of the intervals: %s", caught)
        free_dropped(problem.comm)
    return _intervals(found, keys, problem.whole.pattern)


def values_of(pattern: Pattern, positions: Floats, measures: Measures) -> MeshValues:
    """Return what a mesh tells by the positions of its vertices, (n, 3), in m."""
    found = {key: measure(pattern, positions) for key, measure in measures.items()}
    known = {key: value for key, value in found.items() if np.isfinite(value)}
    return MeshValues(pattern, positions, known)


def values_on(
    job: Job, level: Level, simulated: SimulatedPrint, keys: Sequence[str], ratio: float
) -> MeshValues:
    """Simulate a print on another mesh, as `simulated_on` does; return what it tells (collective).

    Keys are those of metrics, and of what the shape misses.
    """
    return values_at(simulated_on(job, level, simulated, ratio), keys)


def _intervals(
    found: Mapping[float, MeshValues], keys: Iterable[str], whole: Pattern
) -> dict[str, float]:
    """Return half-widths around the values of the finest mesh, where there is a coarser one."""
    intervals: dict[str, float] = {}
    for key in keys:
        known = {ratio: one for ratio, one in found.items() if key in one.values}
        finest = min(known, default=np.inf)
        changes = {
            ratio / finest: abs(one.values[key] - known[finest].values[key])
            for ratio, one in known.items()
            if ratio > finest
        }
        if changes and finest <= 1:
            edge = edge_of(known[finest].pattern.areas)
            intervals[key] = half_width(changes, key, np.ptp(whole.points, axis=0), edge)
    return intervals


def trial_intervals(
    comm: MPI.Comm,
    scene: DesignScene,
    figures: Sequence[Figure],
    other: OnOtherMesh | None,
    own: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return half-widths of the intervals of a trial's figures, by their keys (collective).

    The trial is repeated on another mesh; None leaves intervals out. `own` are errors of other
    causes that a trial tells on its own.
    """
    if other is None:
        return {}
    free_dropped(comm)
    try:
        there = {figure.key: figure.value for figure in scene.trial_figures(comm, other())}
    except TorosError as caught:  # raised by all ranks or by none
        if comm.rank == 0:
            log.warning("the repeated trial, and with it intervals, is left out: %s", caught)
        return {}
    finally:
        free_dropped(comm)
    found: dict[str, float] = {}
    for figure in figures:
        one, two = figure.value, there.get(figure.key)
        if one is not None and two is not None:
            change, ratio = abs(one - two), scene.TRIAL_MESH
            error = change / (max(ratio, 1 / ratio) - 1) + (own or {}).get(figure.key, 0.0)
            # Of a finer mesh, whose value is not told, the interval is around that value.
            found[figure.key] = SAFETY * error + (change if ratio < 1 else 0.0)
    return found


def measures_of(problem: ShapeDesign, keys: Sequence[str]) -> Measures:
    """Return the metrics of a problem, and the values of its miss with these keys."""
    metrics, prefix = {m.key: m.measure for m in problem.metrics}, prefix_of(problem)
    missed = [key for key in keys if key not in metrics and key.startswith(prefix)]
    return metrics | dict(zip(missed, quantities_of(problem, missed), strict=True))


def values_at(made: Evaluation[Equilibrium], keys: Sequence[str]) -> MeshValues:
    """Return what a simulated print tells by these keys in all poses, as of `values_on`.

    It is collective.
    """
    values: dict[str, float] = {}
    for one in made.every:
        assert isinstance(one.problem, ShapeDesign)
        own = one.problem.metrics_of(one.equilibrium)
        values |= {key: value for key, value in own.items() if key in keys}
        values |= values_of(*_shape(one), measures_of(one.problem, keys)).values
    return MeshValues(*_shape(made), values)
