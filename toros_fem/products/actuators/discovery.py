"""Design from a random start without drawn lines: relaxed design, printable lines, correction."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.mpi import free_dropped, on_first_rank
from toros_fem.design.lines.field import LineField
from toros_fem.design.lines.laid_lines import LaidLines
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.design.lines.options import LineOptions
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.corrections import correct
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import Callback, DesignResult, optimize
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.warm_start import WarmStart
from toros_fem.design.relaxed.find import RelaxedResult, find_lines
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.as_printed.printed_lines import clean_print, printed_lines
from toros_fem.making.print.cleaning import CleanedRegions
from toros_fem.making.print.regions import part_regions, regions_on
from toros_fem.measures.metrics import Metric
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.actuators.line_widths import mended_widths
from toros_fem.products.actuators.space_mapping import (
    CLOSE,
    FINE,
    HELPS,
    aims_of,
    asked_next,
    largest_error,
)
from toros_fem.results.console import print_line

if TYPE_CHECKING:  # a scene is designed here, and says so
    from toros_fem.products.actuators.scene import ActuatorScene, Level

# Below this error lines stay where they are, and corrections change their widths first.
NEAR = 0.3


@dataclass(frozen=True, eq=False)
class Round:
    """One relaxed design, laid as lines and simulated.

    Attributes:
        asked: Target of each metric that was asked of the relaxed design, by key.
        relaxed: The relaxed design.
        laid: Its lines.
        printed: Their print, simulated.
        metrics: Metrics of the print, by key; empty without an equilibrium.
        error: Largest distance of a metric from its target, over its scale; infinite without an
            equilibrium.
        widened: Whether these are the lines of the round before, with other widths.
    """

    asked: Mapping[str, float]
    relaxed: RelaxedResult
    laid: LaidLines
    printed: PrintedDesign
    metrics: Mapping[str, float]
    error: float
    widened: bool


@dataclass(frozen=True, eq=False)
class Discovery:
    """Lines that were found from a random start.

    Attributes:
        rounds: All rounds, in the order in which they were made.
        best: The round whose print is closest to the targets.
        case: What was designed, on the mesh that follows the lines of the best round.
        regions: These lines on the panels of that mesh, polygons in m.
        problem: Its density problem.
        seconds: Wall time in s of the relaxed designs, of laying lines, and of simulating prints.
    """

    rounds: tuple[Round, ...]
    best: Round
    case: Case
    regions: list[BaseGeometry]
    problem: ShapeDesign
    seconds: Mapping[str, float]

    def result(self) -> DesignResult:
        """Return the best round as the result of a design; its history is the relaxed design's."""
        best = self.best
        evaluation = best.printed.evaluation
        assert evaluation is not None
        return DesignResult(
            problem=self.problem,
            density=evaluation.projected,
            final=evaluation,
            history=best.relaxed.history,
            reason=best.relaxed.reason,
            seconds=dict(self.seconds),
        )

    def figures(self) -> dict[str, Any]:
        """Return the entries of the summary: relaxed design, lines, and what was asked for."""
        first, best = self.rounds[0], self.best
        return {
            "relaxed": {
                **first.relaxed.metrics,
                "objective": first.relaxed.objective,
                "steps": len(first.relaxed.history),
                "newton_steps": first.relaxed.newton_steps,
                "triangles": len(first.relaxed.field.pattern.panel),
                "seconds": first.relaxed.seconds,
            },
            "lines": {
                **best.metrics,
                "rounds": [
                    {"asked": dict(r.asked), "widened": r.widened, **r.metrics} for r in self.rounds
                ],
                "families": [
                    {
                        "width_mm": 1e3 * f.width,
                        "lines": f.lines,
                        "length_mm": 1e3 * f.length,
                        "share": f.share,
                        "laid": f.laid,
                        "ends": dict(f.ends),
                    }
                    for f in best.laid.families
                ],
                "printed_fraction": best.laid.area / float(best.laid.pattern.areas.sum()),
            },
        }


class _Simulated(NamedTuple):
    """A round, the case and the lines on its mesh, and its problem."""

    round: Round
    case: Case
    regions: list[BaseGeometry]
    problem: ShapeDesign


def discover(
    comm: MPI.Comm,
    scene: ActuatorScene,
    callback: Callback | None = None,
    *,
    verbose: bool = False,
    journal: Journal | None = None,
) -> Discovery:
    """Find printable lines that take an actuator to its target, from noise (collective).

    The relaxed design is laid as lines, which are simulated as printed. Where the print
    misses by far, the next relaxed design asks for more (space mapping, Bandler et al. 1994): it
    costs a fraction of a simulated print. The widths of the lines take away a small miss
    (`mended_widths`). Where a target is in no field of the scene
    (`targets`), there is one round only.

    Args:
        comm: Communicator.
        scene: What to design.
        callback: Called after each step of the relaxed designs, on every rank.
        verbose: Whether to print every Newton step.
        journal: Keeps the relaxed designs and the prints; None keeps nothing.

    Raises:
        NoEquilibriumError: No print has an equilibrium, or the random start has none.
        TorosError: A number is out of its bounds.
    """
    search = _Search(comm, scene, callback, verbose, journal)
    lines = search.ask()
    assert lines is not None  # what the scene itself asks for is within its bounds
    correct(search.print(lines), search.again, search.enough, scene.design.corrections)
    return search.found()


class _Search:
    """The rounds of one search, and what the next one goes on from; all methods are collective."""

    def __init__(
        self,
        comm: MPI.Comm,
        scene: ActuatorScene,
        callback: Callback | None,
        verbose: bool,
        journal: Journal | None,
    ) -> None:
        self.comm, self.scene = comm, scene
        self.callback, self.verbose, self.journal = callback, verbose, journal
        self.seconds = {"relaxed": 0.0, "lines": 0.0, "prints": 0.0}
        self.plain = scene.case(comm, scene.print_level)  # the mesh that is moved onto lines
        self.aims = aims_of(self.plain.judged)
        self.asked = {key: aim.target for key, aim in self.aims.items()}
        self.rounds: list[Round] = []
        self.relaxed: RelaxedResult | None = None
        self.near: tuple[Pattern, Floats] | None = None  # the shape that a print starts from
        self.widened = False  # whether the lines to print are the last ones with other widths
        self.answers: list[Round] = []  # rounds whose widths are as laid
        self.like: LaidLines | None = None
        self.alike = 0  # first of the answers with these lines
        self.last: _Simulated | None = None
        self.best: _Simulated | None = None
        self.fruitless = 0  # rounds since the best one

    def ask(self) -> LaidLines | None:
        """Return the lines of a relaxed design of what is asked; None where it cannot be asked.

        Raises:
            NoEquilibriumError: The random start has no equilibrium.
        """
        comm, scene = self.comm, self.scene
        begin = time.perf_counter()
        try:
            # First the scene's own targets, which may be in none of its fields.
            asked = scene.asked(self.asked if self.rounds else {})
        except ParameterError:  # beyond what the targets' fields allow
            return None
        level = scene.relaxed_level
        case = asked.case(comm, level)
        design = scene.problem(comm, case, level, verbose=self.verbose)
        options = scene.relaxed_options
        try:
            self.relaxed = find_lines(
                design,
                options,
                seed=scene.design.seed,
                callback=self.callback,
                after=self.relaxed,
                journal=self.journal,
            )
        except NoEquilibriumError:
            if not self.rounds:
                raise
            return None
        middle = time.perf_counter()
        lines = _laid(comm, case, self.relaxed.field, scene.line_options, self.like)
        self.near, self.widened = (case.pattern, self.relaxed.positions), False
        self.seconds["relaxed"] += middle - begin
        self.seconds["lines"] += time.perf_counter() - middle
        return lines

    def print(self, lines: LaidLines) -> Round:
        """Simulate the print of lines: a round."""
        begin = time.perf_counter()
        self.last = None  # its problem is freed if it is not the best one's
        free_dropped(self.comm)
        relaxed, near = self.relaxed, self.near
        assert relaxed is not None
        assert near is not None
        fine, regions, problem, printed = _printed(
            self.comm,
            self.scene,
            self.scene.print_level,
            self.plain,
            _Lines(lines, near, relaxed.pressures or None),
            self.verbose,
            self.journal,
        )
        metrics, error = {}, np.inf
        if printed.evaluation is not None:
            metrics = problem.metrics_of(printed.evaluation.equilibrium)
            error = largest_error(metrics, self.aims)
        made = Round(dict(self.asked), relaxed, lines, printed, metrics, error, self.widened)
        self.rounds.append(made)
        if not made.widened:
            self.answers.append(made)
        self.last = _Simulated(made, fine, regions, problem)
        self.fruitless += 1
        if self.best is None or error < self.best.round.error:
            self.best, self.fruitless = self.last, 0
        self.seconds["prints"] += time.perf_counter() - begin
        _report(self.comm, len(self.rounds) - 1, problem.metrics, made)
        return made

    def enough(self, rounds: Sequence[Round]) -> bool:
        """Return whether the search ends with these rounds."""
        assert self.best is not None
        made = rounds[-1]
        return (
            made.error < CLOSE
            or not set(self.aims) <= set(self.scene.targets())
            or (made.printed.evaluation is None and not made.widened)
            or (self.best.round.error < FINE and self.fruitless > 1)
        )

    def again(self, rounds: Sequence[Round]) -> Round | None:
        """Print other lines, or the last ones with other widths; None where none can be asked."""
        lines = self._next_lines()
        return None if lines is None else self.print(lines)

    def _next_lines(self) -> LaidLines | None:
        last, best = self.last, self.best
        assert last is not None
        assert best is not None
        made, error = last.round, last.round.error
        fitting = best.round.error < FINE
        if self.like is None and error < NEAR:
            self.like, self.alike = made.laid, len(self.answers) - 1
        helped = not made.widened or error < HELPS * self.rounds[-2].error
        if error < NEAR and (helped or fitting):
            wider = self._widened(last)
            if wider is not None:
                return wider
        self.asked = asked_next(self.answers[self.alike :], self.aims)
        return self.ask()

    def _widened(self, last: _Simulated) -> LaidLines | None:
        """Return the last lines with other widths; None where these cannot help."""
        begin = time.perf_counter()
        made, evaluation = last.round, last.round.printed.evaluation
        assert evaluation is not None
        wider = mended_widths(
            self.comm, last.problem, made.printed, made.laid, made.metrics, self.aims
        )
        self.near = last.case.pattern, last.problem.shape_of(evaluation.equilibrium)
        self.widened = True
        self.seconds["lines"] += time.perf_counter() - begin
        return wider

    def found(self) -> Discovery:
        """Return the best round and all others.

        Raises:
            NoEquilibriumError: No print has an equilibrium.
        """
        best = self.best
        assert best is not None
        if not np.isfinite(best.round.error):
            raise NoEquilibriumError(
                "no print of the relaxed design has an equilibrium: "
                f"{self.rounds[0].printed.failure} Ask for less, or for finer lines (laid_width)."
            )
        return Discovery(tuple(self.rounds), *best, self.seconds)


def metrics_on_coarser_mesh(
    comm: MPI.Comm, scene: ActuatorScene, found: Discovery
) -> tuple[float, Mapping[str, float]]:
    """Return how much longer edges can be, at most 2 times, and the best print's metrics then.

    It is collective.

    Args:
        comm: Communicator.
        scene: What was designed.
        found: What `discover` returned.

    Raises:
        NoEquilibriumError: The print has no equilibrium on that mesh.
        ParameterError: There is no coarser mesh.
    """
    ratio, level = scene.coarser_print_level()
    best, evaluation = found.best, found.best.printed.evaluation
    assert evaluation is not None
    near = found.case.pattern, found.problem.shape_of(evaluation.equilibrium)
    lines = _Lines(best.laid, near, evaluation.equilibrium.pressures)
    plain = scene.case(comm, level)
    _, _, problem, printed = _printed(comm, scene, level, plain, lines, verbose=False)
    if printed.evaluation is None:
        raise NoEquilibriumError(printed.failure)
    return ratio, problem.metrics_of(printed.evaluation.equilibrium)


def densities_last(
    comm: MPI.Comm,
    scene: ActuatorScene,
    found: Discovery,
    callback: Callback | None = None,
    *,
    verbose: bool = False,
    journal: Journal | None = None,
) -> tuple[DesignResult, PrintedDesign] | None:
    """Design the densities on from the best lines; None without an equilibrium (collective).

    Width constraints hold from the first step, and the filter radius is about the lines' width.

    Args:
        comm: Communicator.
        scene: What was designed.
        found: What `discover` returned.
        callback: Called after each step, on every rank.
        verbose: Whether to print every Newton step.
        journal: As of `optimize`.
    """
    best = found.best
    problem = scene.problem(comm, found.case, scene.density_level, verbose=verbose)
    lines = best.printed.evaluation
    assert lines is not None
    # Another problem may share out the triangles otherwise.
    density = found.problem.skin.gather_cells(lines.projected)
    warm = WarmStart(
        density=density[problem.skin.owned_cells],
        pressures=lines.equilibrium.pressures,
        state=problem.state_at(found.problem.shape_of(lines.equilibrium)),
        history=best.relaxed.history,
        level=best.relaxed.history[-1].level + 1,
    )
    try:
        result = optimize(
            problem, scene.density_options, callback=callback, after=warm, journal=journal
        )
    except NoEquilibriumError:  # of the blurred lines; raised by all ranks or by none
        return None
    printed = as_printed(
        problem, result, scene.print.limits, island_area=scene.print.island_area, journal=journal
    )
    return result, printed


def _laid(
    comm: MPI.Comm,
    case: Case,
    field: LineField,
    options: LineOptions,
    like: LaidLines | None,
) -> LaidLines:
    """Return the lines of a field on the triangles that are designed (collective)."""
    printed = None if case.passive is None else case.passive > 0.5
    return on_first_rank(
        comm,
        lambda: lay_lines(field, options, printed=printed, planes=tuple(case.symmetry), like=like),
    )


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines to simulate, and the shape and the pressures that this starts from."""

    laid: LaidLines
    near: tuple[Pattern, Floats]
    pressure: Sequence[float] | None


def _printed(
    comm: MPI.Comm,
    scene: ActuatorScene,
    level: Level,
    case: Case,
    lines: _Lines,
    verbose: bool,
    journal: Journal | None = None,
) -> tuple[Case, list[BaseGeometry], ShapeDesign, PrintedDesign]:
    """Return the case on a mesh that follows the lines, these, the problem and the print.

    It is collective.
    """
    part, laid, printer = case.pattern, lines.laid, scene.print

    def cleaning() -> tuple[CleanedRegions, list[BaseGeometry]]:
        found = regions_on(laid.pattern, laid.regions, part)
        cleaned = clean_print(part, case.whole, found, printer.limits, printer.island_area)
        return cleaned, part_regions(part, cleaned.regions)

    cleaned, regions = on_first_rank(comm, cleaning)
    fine = case.following(comm, regions)
    problem = scene.problem(comm, fine, level, verbose=verbose)
    printed = printed_lines(
        problem,
        part,
        regions,
        printer.limits,
        cleaned=cleaned,
        near=lines.near,
        pressure=lines.pressure,
        journal=journal,
    )
    return fine, regions, problem, printed


def _report(comm: MPI.Comm, number: int, metrics: tuple[Metric, ...], made: Round) -> None:
    """Print a line on a round, on the first rank."""
    if comm.rank:
        return
    parts = [
        f"{m.name} {m.formatted(made.metrics[m.key])} of {m.formatted(m.target)}"
        + f", asked {m.formatted(made.asked[m.key])}"
        for m in metrics
        if m.target is not None and made.metrics
    ]
    lines = sum(f.lines for f in made.laid.families)
    found = "; ".join(parts) if made.printed.evaluation is not None else "no equilibrium"
    widths = " of other widths" if made.widened else ""
    print_line(f"round {number}: {lines} lines{widths}, as printed {found}")
