"""Design from a random start without drawn lines: relaxed design, printable lines, correction."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem._mpi import free_dropped, on_first_rank
from toros_fem._types import Floats
from toros_fem.actuators.case import ActuatorCase
from toros_fem.actuators.config import ActuatorConfig
from toros_fem.actuators.line_widths import mended_widths
from toros_fem.actuators.problem import CaseMaker, actuator_problem
from toros_fem.actuators.space_mapping import CLOSE, Aim, aims_of, asked_next, largest_error
from toros_fem.design.loop import Callback, DesignResult, optimize
from toros_fem.design.shape_design import ShapeDesign
from toros_fem.design.warm_start import WarmStart
from toros_fem.errors import NoEquilibriumError, ParameterError
from toros_fem.fabrication.as_printed import PrintedDesign, as_printed
from toros_fem.fabrication.printed_lines import printed_lines, regions_on
from toros_fem.lines.field import LineField
from toros_fem.lines.laid_lines import LaidLines
from toros_fem.lines.lay_lines import lay_lines
from toros_fem.lines.options import LineOptions
from toros_fem.meshes.pattern import Pattern
from toros_fem.objectives.metrics import Metric
from toros_fem.output.console import print_line
from toros_fem.relaxed.find import RelaxedResult, find_lines

# Below this error lines stay where they are, and corrections change their widths first.
NEAR = 0.3
# Other widths help if the error is at most this fraction of the one before.
HELPS = 0.7
# Below this error only widths change any more, and two rounds that are no better are the last:
# moving lines costs more than there is to gain, and what is left is the mesh's error.
FINE = 0.05

C = TypeVar("C", bound=ActuatorConfig)


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
    case: ActuatorCase
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


def discover(
    comm: MPI.Comm,
    case: CaseMaker[C],
    config: C,
    callback: Callback | None = None,
    *,
    verbose: bool = False,
) -> Discovery:
    """Find printable lines that take an actuator to its target, from noise (collective).

    The relaxed design is laid as lines, which are simulated as printed. What the print misses by
    far is asked of the relaxed design on top, and so on (space mapping, Bandler et al. 1994): a
    relaxed design costs a fraction of a simulated print. What it misses by little is mended by the
    widths of its lines (`mended_widths`). Where a target is in no field of the configuration
    (`TARGETS`), there is one round only.

    Args:
        comm: Communicator.
        case: Makes what to design, of the communicator and a configuration.
        config: All numbers.
        callback: Called after each step of the relaxed designs, on every rank.
        verbose: Whether to print every Newton step.

    Raises:
        NoEquilibriumError: No print has an equilibrium, or the random start has none.
        TorosError: A number is out of its bounds.
    """
    seconds = {"relaxed": 0.0, "lines": 0.0, "prints": 0.0}
    plain: ActuatorCase | None = None
    relaxed: RelaxedResult | None = None
    aims: dict[str, Aim] = {}
    asked: dict[str, float] = {}
    like: LaidLines | None = None
    wider: LaidLines | None = None  # lines of the last round with other widths
    fruitless = 0  # rounds since the best one
    alike = 0  # first of the answers that can be compared
    rounds: list[Round] = []
    answers: list[Round] = []  # those of relaxed designs, whose widths are as laid
    best: tuple[Round, ActuatorCase, list[BaseGeometry], ShapeDesign] | None = None
    for number in range(1 + config.corrections):
        begin = time.perf_counter()
        if wider is None:
            try:
                coarse = config.of_relaxed.asked(asked)
            except ParameterError:  # beyond what the targets' fields allow
                break
            here = case(comm, coarse)
            if not rounds:
                aims = aims_of(here.metrics)
                asked = {key: aim.target for key, aim in aims.items()}
            design = actuator_problem(comm, here, coarse, verbose=verbose)
            options = config.relaxed_options
            try:
                relaxed = find_lines(
                    design, options, seed=config.seed, callback=callback, after=relaxed
                )
            except NoEquilibriumError:
                if not rounds:
                    raise
                break
        assert relaxed is not None
        middle = time.perf_counter()
        if wider is None:
            lines = _laid(comm, here, relaxed.field, config.line_options, like)
            near = here.pattern, relaxed.positions
        else:
            lines = wider
        end = time.perf_counter()
        plain = case(comm, config.of_print) if plain is None else plain
        fine, regions, problem, printed = _printed(
            comm, plain, config, near, lines, relaxed.pressures or None, verbose
        )
        metrics = {}
        if printed.evaluation is not None:
            metrics = problem.metrics_of(printed.evaluation.equilibrium)
        error = np.inf if printed.evaluation is None else largest_error(metrics, aims)
        made = Round(dict(asked), relaxed, lines, printed, metrics, error, wider is not None)
        helped = not made.widened or error < HELPS * rounds[-1].error
        rounds.append(made)
        if best is None or error < best[0].error:
            best = made, fine, regions, problem  # the problems of the others are freed
        fruitless = 0 if best[0] is made else fruitless + 1
        if not made.widened:
            answers.append(made)
        seconds["relaxed"] += middle - begin
        seconds["lines"] += end - middle
        seconds["prints"] += time.perf_counter() - end
        _report(comm, number, problem.metrics, made)
        if error < CLOSE or not set(aims) <= set(config.TARGETS):
            break
        if printed.evaluation is None and not made.widened:
            break
        fitting = best[0].error < FINE
        if fitting and fruitless > 1:
            break
        if like is None and error < NEAR:
            like, alike = lines, len(answers) - 1
        wider = None
        if error < NEAR and (helped or fitting):
            wider = mended_widths(comm, problem, made.printed, lines, metrics, aims)
            assert printed.evaluation is not None
            near = fine.pattern, problem.shape_of(printed.evaluation.equilibrium)
        if wider is None:
            asked = asked_next(answers[alike:], aims)
        del problem, fine, regions
        free_dropped(comm)
    assert best is not None
    if not np.isfinite(best[0].error):
        raise NoEquilibriumError(
            f"no print of the relaxed design has an equilibrium: {rounds[0].printed.failure} "
            "Ask for less, or for finer lines (laid_width)."
        )
    return Discovery(tuple(rounds), *best, seconds)


def densities_last(
    comm: MPI.Comm,
    config: ActuatorConfig,
    found: Discovery,
    callback: Callback | None = None,
    *,
    verbose: bool = False,
) -> tuple[DesignResult, PrintedDesign] | None:
    """Design the densities on from the best lines; None without an equilibrium (collective).

    Width constraints hold from the first step, and the filter radius is about the lines' width.

    Args:
        comm: Communicator.
        config: As of `discover`.
        found: What it returned.
        callback: Called after each step, on every rank.
        verbose: Whether to print every Newton step.
    """
    best = found.best
    problem = actuator_problem(comm, found.case, config.of_densities, verbose=verbose)
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
        result = optimize(problem, config.density_options, callback=callback, after=warm)
    except NoEquilibriumError:  # of the blurred lines; raised by all ranks or by none
        return None
    printed = as_printed(problem, result, config.print_limits, island_area=config.island_area)
    return result, printed


def _laid(
    comm: MPI.Comm,
    case: ActuatorCase,
    field: LineField,
    options: LineOptions,
    like: LaidLines | None,
) -> LaidLines:
    """Return the lines of a field on the triangles that are designed (collective)."""
    printed = None if case.passive is None else case.passive > 0.5
    return on_first_rank(
        comm, lambda: lay_lines(field, options, printed=printed, planes=case.symmetry, like=like)
    )


def _printed(
    comm: MPI.Comm,
    case: ActuatorCase,
    config: ActuatorConfig,
    near: tuple[Pattern, Floats],
    laid: LaidLines,
    pressure: Sequence[float] | None,
    verbose: bool,
) -> tuple[ActuatorCase, list[BaseGeometry], ShapeDesign, PrintedDesign]:
    """Return the case on a mesh that follows the lines, these, the problem and the print.

    It is collective.
    """
    regions = on_first_rank(comm, lambda: regions_on(laid.pattern, laid.regions, case.pattern))
    fine = case.following(comm, regions)
    problem = actuator_problem(comm, fine, config.of_print, verbose=verbose)
    printed = printed_lines(
        problem,
        laid.pattern,
        laid.regions,
        config.print_limits,
        island_area=config.island_area,
        near=near,
        pressure=pressure,
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
