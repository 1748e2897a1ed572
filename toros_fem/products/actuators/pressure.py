"""A print over the pressure: where it is nearest to its targets, and its curve."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.files import guarded, write_table
from toros_fem.base.mpi import largest
from toros_fem.base.validation import Floats, require_between, require_kind
from toros_fem.design.loop.miss import prefix_of, worst_figure
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.making.as_printed import PrintedDesign
from toros_fem.measures.figures import DEFAULT, Tolerances, largest_part
from toros_fem.measures.metrics import Measurement
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import follow_pressures
from toros_fem.mechanics.paths.trace_point import TracePoint, measured_point, until_failure
from toros_fem.products.common.tables import ResultTable
from toros_fem.results.runs.record import shown_skin, write_path
from toros_fem.results.runs.stored_run import notes_at

# Largest change of the pressure, as a fraction of it.
SHARE = 0.15
# A print is trimmed while a figure is off by more than this part of its tolerance, so often at
# most; a change is tried that promises to leave at most this part of the worst figure.
ENOUGH, ROUNDS, PROMISING = 0.25, 3, 0.9
# Number of pressures at which figures are predicted.
SAMPLES = 61
# Below its first step the pressure is halved so often, since slender skins move most there.
HALVINGS = 6
# Between points by which the skin moves by more than its way over this number there are more.
PARTS = 12
# Shapes that differ by less than this part of the skin's size are the same.
JOINED = 1e-3
OTHER_SHAPE = "inflated from rest, the skin takes another shape"
NO_POSE_FROM_REST = "inflating from rest finds no equilibrium"
NOT_FROM_REST = "inflating from rest to the curve's lowest pressure finds no equilibrium"
# Pressures that differ by this fraction are the same.
SAME = 1e-9


def trimmed(
    printed: PrintedDesign,
    share: float = SHARE,
    tolerances: Tolerances = DEFAULT,
    *,
    designed: Sequence[float] | None = None,
) -> PrintedDesign:
    """Return a print at the pressure where its worst figure is nearest to its target (collective).

    The motion of all vertices with the logarithm of the pressure is y of K y = Σ p ∂V/∂x, by one
    solve with the tangent of the print. It predicts all figures along the pressure: angles,
    distances, directions. The print is simulated where the largest of them over its tolerance is
    least, and kept there if it is better. Pressures of several chambers keep their ratios. They
    may fall below their lower bounds, and none rises above its upper bound, or above the one that
    is prescribed.

    Args:
        printed: A print; without an equilibrium it is returned as it is.
        share: Largest change of the pressure, as a fraction of it, at most 0.9; 0 changes
            nothing.
        tolerances: How far figures may be off.
        designed: Pressures in Pa that the share is of; None takes those of the print.

    Raises:
        ParameterError: The share is out of its bounds.
    """
    require_kind("printed", printed, PrintedDesign, "the PrintedDesign of as_printed")
    require_between(0.0, 0.9, share=share)
    made = printed.evaluation
    if made is None or share == 0 or not isinstance(made.problem, ShapeProblem):
        return printed
    problem, at = made.problem, made.equilibrium.pressures
    largest = max(at, default=0.0)
    if not largest > 0:
        return printed
    moved = float(np.log(largest / max(designed))) if designed else 0.0
    lowest, highest = np.log1p(-share) - moved, np.log1p(share) - moved

    ranges = problem.physics.pressure_ranges
    for own, given, bounds in zip(at, problem.physics.pressures, ranges, strict=True):
        if own > 0:
            highest = min(highest, float(np.log((bounds[1] if bounds else given) / own)))
    least, total = _worst(made, tolerances), 0.0
    for _ in range(ROUNDS):
        if least <= ENOUGH or not highest > lowest:
            break
        steps = np.linspace(lowest, highest, SAMPLES) - total
        promised = np.max([_promised(one, steps, tolerances) for one in made.every], axis=0)
        best = int(np.argmin(promised))
        if promised[best] > PROMISING * least:
            break
        factor = float(np.exp(steps[best]))
        try:
            other = problem.simulate_binary(
                made.projected, made, pressure=[factor * p for p in made.equilibrium.pressures]
            )
        except NoEquilibriumError:  # raised by all ranks or by none
            break
        worst = _worst(other, tolerances)
        if worst >= least:
            break
        made, least, total = other, worst, total + float(steps[best])
    return replace(printed, evaluation=made)


def worst_of_print(printed: PrintedDesign, tolerances: Tolerances = DEFAULT) -> float:
    """Return the largest distance of a figure of a print from its target, over its tolerance.

    It is infinite without an equilibrium (collective).
    """
    made = printed.evaluation
    if made is None or not isinstance(made.problem, ShapeProblem):
        return np.inf
    return _worst(made, tolerances)


def _worst(made: Evaluation[Equilibrium], tolerances: Tolerances) -> float:
    """Return the worst figure of all poses."""
    return max(_worst_of_pose(one, tolerances) for one in made.every)


def _worst_of_pose(made: Evaluation[Equilibrium], tolerances: Tolerances) -> float:
    problem = _problem(made)
    if problem.target is None:  # the goal is a force
        values = problem.metrics_of(made.equilibrium)
        return largest_part(
            [m.figure(values[m.key], None, tolerances.figure) for m in problem.metrics]
        )
    return worst_figure(problem, _shape(made), tolerances)


def _promised(made: Evaluation[Equilibrium], steps: Floats, tolerances: Tolerances) -> list[float]:
    """Return the worst figure of a pose where the logarithm of its pressures changes by steps."""
    problem, shape = _problem(made), _shape(made)
    if problem.target is None:
        return [_worst_of_pose(made, tolerances)] * len(steps)
    motion = _motion(problem, made.equilibrium)
    return [worst_figure(problem, shape + step * motion, tolerances) for step in steps]


def _problem(made: Evaluation[Equilibrium]) -> ShapeProblem:
    assert isinstance(made.problem, ShapeProblem)
    return made.problem


def _shape(made: Evaluation[Equilibrium]) -> Floats:
    found = made.problem.physics.shape_of(made.equilibrium)
    assert found is not None
    return found


def _motion(problem: ShapeProblem, at: Equilibrium) -> Floats:
    """Return the derivative of all vertices by the logarithm of the pressures, (n, 3)."""
    solver = problem.solver
    solver.tangent_at(at)
    push = np.zeros_like(at.state)
    for chamber, pressure in enumerate(at.pressures):
        push += pressure * solver.model.volume_gradient(at.state, chamber)
    return problem.skin.gather_vertices(solver.model.positions(solver.solve_tangent(push, at)))


@dataclass(frozen=True)
class CurveFigures:
    """What the curve of a print tells.

    Attributes:
        failure: Why there is none; None if there is one.
        lowest_pa, highest_pa: Its ends.
        points: Number of equilibria.
        unfilled_at_pa: Largest pressure at which the skin was found to enclose less than its
            assembled shape, which is no point any more; None if it was filled at all.
        failure_below, failure_above: Why there is no equilibrium at lower or higher pressures;
            None if the curve was followed to its end.
        joins_rest: Whether the skin takes the shape of the lowest point too where it is inflated
            from rest; None if this finds no equilibrium.
        measured: Measured values, each beside the simulated one.
        notes: What is not as usual at its points, as sentences.
        seconds: Wall time.
    """

    failure: str | None = None
    lowest_pa: float | None = None
    highest_pa: float | None = None
    points: int = 0
    unfilled_at_pa: float | None = None
    failure_below: str | None = None
    failure_above: str | None = None
    joins_rest: bool | None = None
    measured: Sequence[Mapping[str, Any]] = ()
    notes: Sequence[str] = ()
    seconds: float | None = None

    @property
    def doubt(self) -> str | None:
        """Why the print may not take the shape that is told; None where inflating reaches it."""
        if self.joins_rest is False:
            return OTHER_SHAPE
        return NOT_FROM_REST if self.points and self.joins_rest is None else None


def trace_pressure_curve(
    problem: ShapeProblem,
    made: Evaluation[Equilibrium],
    largest: float,
    steps: int,
    further: Sequence[float] = (),
) -> tuple[list[TracePoint], CurveFigures]:
    """Follow a print from its pressure down until the skin is not filled, and up (collective).

    The pressures are multiples of the step. Below one step they are halved, `HALVINGS` times at
    most. Where the skin moves far there are pressures between them. Several chambers keep the
    ratios of their pressures. A skin is filled where it encloses at least the volume of its
    assembled shape. While its equilibria are stable, the volume of a chamber rises with its
    pressure, so that this begins at one pressure.

    Returned are the equilibria by rising pressure, that of the print among them, and their figures.

    Args:
        made: Evaluation of the print, at its pressure.
        largest: Largest pressure in Pa; the curve ends at that of the print if this is larger.
        steps: Number of steps from 0 to there.
        further: Further pressures in Pa, > 0; those above the largest are left out.
    """
    solver, begin = problem.solver, made.equilibrium
    pressures = np.asarray(begin.pressures)
    ratios = pressures / begin.pressure if begin.pressure > 0 else np.ones_like(pressures)
    lower, higher = _pressures(begin.pressure, largest, steps, further)

    rest, model = problem.skin.pattern.points, solver.model
    empty = float(sum(model.volumes(model.assembled)))
    middle = measured_point(solver, begin, problem.metrics)
    below: list[TracePoint] = []
    above: list[TracePoint] = []

    def known() -> list[TracePoint]:
        return [*reversed(below), middle, *above]

    def largest_motion() -> float:
        """Return the known way over PARTS, from rest straight to the lowest point, in m."""
        return float(_moves([rest, *(point.positions for point in known())]).sum()) / PARTS

    def follow(
        levels: Sequence[float],
        start: Equilibrium,
        found: list[TracePoint],
        largest: Callable[[], float] | None,
    ) -> str | None:
        """Add the points as long as the skin is filled; return why there are no more."""
        loads = [[float(p) for p in level * ratios] for level in levels]
        path = follow_pressures(solver, made.projected, loads, problem.metrics, start, largest)

        def filled() -> Iterator[TracePoint]:
            for point in path:
                found.append(point)  # at once: the largest motion grows with the way
                yield point
                if point.result.volume < empty:
                    return

        return until_failure(filled())[1] or None

    failure_below = follow(lower, begin, below, largest_motion)
    failure_above = follow(higher, begin, above, largest_motion)
    unfilled_at = None
    if below and below[-1].result.volume < empty:
        unfilled_at = below.pop().result.pressure
    points = known()
    for k, between in reversed(list(enumerate(_between(points, rest)))):
        # Downwards, as the curve: a skin that snaps does so at a lower pressure when it empties.
        more: list[TracePoint] = []
        follow(between[::-1], points[k + 1].result, more, None)
        points[k + 1 : k + 1] = reversed(more)
    found = CurveFigures(
        None,
        points[0].result.pressure,
        points[-1].result.pressure,
        len(points),
        unfilled_at,
        failure_below,
        failure_above,
        _joins_rest(solver, made.projected, points[0].result),
        notes=notes_at((p.result.pressure, p.result.condition.sentences) for p in points),
    )
    return points, found


def doubts_of_poses(made: Evaluation[Equilibrium]) -> list[str]:
    """Return which further poses of a print inflating from rest does not reach (collective)."""
    doubts = []
    for one in made.poses:
        problem = _problem(one)
        joins = _joins_rest(problem.solver, one.projected, one.equilibrium)
        if not joins:
            doubt = OTHER_SHAPE if joins is False else NO_POSE_FROM_REST
            doubts.append(f"{prefix_of(problem).rstrip('_')}: {doubt}")
    return doubts


def _joins_rest(solver: EquilibriumSolver, density: Floats, at: Equilibrium) -> bool | None:
    """Return whether inflating from rest ends in the shape of an equilibrium (collective)."""
    try:
        found = solver.solve(density, at.load)
    except (EquilibriumError, ParameterError):  # raised by all ranks or by none
        return None
    off = np.abs(found.positions - at.positions).max(initial=0.0)
    skin = solver.model.skin
    return largest(skin.comm, off) < JOINED * skin.pattern.size


def _moves(shapes: Sequence[Floats]) -> Floats:
    """Return how far the skin moves from one shape to the next, in m."""
    return np.array([np.linalg.norm(b - a) for a, b in pairwise(shapes)])


def _between(points: Sequence[TracePoint], rest: Floats) -> list[list[float]]:
    """Return pressures in Pa to add after each point but the last, rising.

    Args:
        points: Equilibria by rising pressure.
        rest: Positions of all vertices at rest, (n, 3), in m.
    """
    moves = _moves([rest, *(point.positions for point in points)])
    parts = np.ceil(PARTS * moves[1:] / moves.sum()).astype(int)
    pressures = [point.result.pressure for point in points]
    return [
        [float(p) for p in np.linspace(low, high, count + 1)[1:-1]]
        for (low, high), count in zip(pairwise(pressures), parts, strict=True)
    ]


def _pressures(
    design: float, largest: float, steps: int, further: Sequence[float]
) -> tuple[list[float], list[float]]:
    """Return the pressures in Pa below that of the design, falling, and above, rising."""
    grid = largest * np.arange(1, steps + 1) / steps
    for pressure in further:
        if pressure <= largest and not np.isclose(grid, pressure, rtol=SAME, atol=0).any():
            grid = np.sort([*grid, pressure])
    lower = [float(p) for p in grid[::-1] if p < (1 - SAME) * design]
    least = lower[-1] if lower else design
    if least > 0:
        lower += [least / 2**k for k in range(1, HALVINGS + 1)]
    return lower, [float(p) for p in grid if p > (1 + SAME) * design]


def write_curve(
    comm: MPI.Comm,
    folder: Path,
    printed: PrintedDesign,
    config: ResultTable,
    measured: Sequence[Measurement] = (),
) -> CurveFigures | None:
    """Write curve.csv and frames, and return what they tell; None without a curve (collective).

    The folder is made if missing. Of the measured values those of metrics with the same target are
    compared.

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    if config.curve_pressure is None:
        return None
    if printed.evaluation is None:
        return CurveFigures(printed.failure)
    begin = time.perf_counter()
    made = printed.evaluation
    problem = made.problem
    assert isinstance(problem, ShapeProblem)
    compared = [m for m in measured if any(m.belongs_to(metric) for metric in problem.metrics)]
    further = [m.pressure for m in compared]
    points, found = trace_pressure_curve(
        problem, made, config.curve_pressure, config.curve_steps, further
    )
    rows = [
        {
            "pressure_pa": point.result.pressure,
            "volume_m3": problem.parts * point.result.volume,
            "stretch_use": point.result.stretch_use,
            **point.metrics,
        }
        for point in points
    ]
    skin = shown_skin(problem, printed.regions, made.equilibrium.poses)

    def write() -> None:
        write_table(folder / "curve.csv", rows)
        write_path(folder, "pressure", skin, points, problem.whole)

    guarded(comm, folder, write)
    beside = [_beside(m, rows) for m in compared]
    return replace(found, measured=beside, seconds=time.perf_counter() - begin)


def _beside(measured: Measurement, rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Return a measured value beside the simulated one."""
    return {
        "metric": measured.key,
        "pressure_pa": measured.pressure,
        "measured": measured.value,
        "simulated": _at(measured.pressure, rows, measured.key),
        "source": measured.source,
    }


def _at(pressure: float, rows: Sequence[Mapping[str, float]], key: str) -> float | None:
    """Return a metric at the point of a pressure; None if the curve does not reach it."""
    at = [row["pressure_pa"] for row in rows]
    found = np.flatnonzero(np.isclose(at, pressure, rtol=SAME, atol=0))
    return rows[found[0]][key] if len(found) else None
