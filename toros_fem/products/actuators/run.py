"""Design of an actuator from start to files: optimise, print, polish, estimate, write."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.files import write_together
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.levels import optimize_levels
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.starts import BestStart, best_start
from toros_fem.design.relaxed.find import RelaxedResult
from toros_fem.making.as_printed.as_printed import (
    PrintedDesign,
    as_printed,
    connect_islands,
    remove_islands,
)
from toros_fem.making.as_printed.print_spread import PrintSpread, print_spread
from toros_fem.making.sheets.write import FOLDER, if_possible, write_manufacture
from toros_fem.measures.metrics import UNITS, Metric
from toros_fem.mechanics.equilibrium.solver import (
    EquilibriumError,
    EquilibriumResult,
    EquilibriumSolver,
)
from toros_fem.mechanics.readings.error_estimate import estimate_error
from toros_fem.products.actuators.cost import require_affordable_meshes
from toros_fem.products.actuators.discovery import (
    Discovery,
    densities_last,
    discover,
    metrics_on_coarser_mesh,
)
from toros_fem.products.actuators.pressure_curve import curve_figures
from toros_fem.products.actuators.space_mapping import (
    CLOSE,
    FINE,
    HELPS,
    aims_of,
    asked_next,
    largest_error,
)
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.runs.folder import journal_of, run_of
from toros_fem.results.writer import write_results

if TYPE_CHECKING:  # a scene is designed here, and says so
    from toros_fem.products.actuators.scene import ActuatorScene


@dataclass(frozen=True, eq=False)
class ActuatorResult:
    """The result of a design run.

    Attributes:
        summary: All figures, as written to summary.json.
        result: The result of the design loop.
        printed: The printed pattern and its simulation.
        problem: The design problem.
    """

    summary: dict[str, Any]
    result: DesignResult
    printed: PrintedDesign
    problem: ShapeDesign


# Error of a metric that is as bad as a design whose contours have islands, or lines or gaps that
# cannot be printed, before they are cleaned.
UNCLEAN = 0.02
# Order of convergence that the errors of laid lines are estimated with. On the nets and twisting
# lines of docs/manufacture.md, edges twice as long changed a figure by 3 to 18 times its error.
ORDER_OF_LINES = 1.5


def design_actuator(
    comm: MPI.Comm,
    output: Path | str,
    scene: ActuatorScene,
    reporter: DesignReporter | None = None,
    *,
    verbose: bool = False,
) -> ActuatorResult:
    """Design an actuator and write all results (collective).

    The design goes from coarse to fine over the levels of the scene. On each, free islands
    of the printed pattern are removed, or connected to the rest if that gives a lower T, and the
    design is continued for `polish_iterations` steps. With several starts the best one takes the
    place of the first level; its islands are left to the next. What the print misses is asked of
    the design on top, `corrections` times.

    With `scene.design.start` = "relaxed" line families are designed and laid as lines instead, by
    `discover`, and densities come last.

    At the end the metrics of the print are followed over the pressure, by `curve_figures`.

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields and pictures.
        scene: What to design.
        reporter: Reports the progress; None makes one for `output`. One that is made earlier also
            counts the time of the set-up.
        verbose: Whether to print every Newton step.

    Raises:
        TorosError: A number is out of its bounds, the start has no equilibrium, or the folder
            cannot be written to.
    """
    reporter, journal = reporter or DesignReporter(comm, output), journal_of(output)
    require_affordable_meshes(comm, scene)
    if scene.design.start == "relaxed":
        return _from_lines(comm, output, scene, reporter, verbose, journal)
    levels, options, design = scene.levels, scene.options, scene.design
    best: BestStart | None = None
    if design.starts > 1:

        def on_coarsest(alone: MPI.Comm) -> ShapeDesign:
            return scene.problem(alone, scene.case(alone, levels[0]), levels[0])

        seeds = range(design.seed, design.seed + design.starts)
        best = best_start(comm, on_coarsest, options[0], seeds, journal)
        for row in best.design.history:
            reporter.report(row)
        # With one mesh alone all ranks finish the best design on it.
        levels, options = levels[1:] or levels, options[1:] or (design.finer_options,)
    problems = (
        scene.problem(comm, scene.case(comm, level), level, verbose=verbose) for level in levels
    )
    with reporter:
        result, printed = _printed_design(problems, options, scene, reporter, best, journal)

        def goal(other: ActuatorScene) -> Case:
            return other.case(comm, levels[-1])

        best_print = _corrected(scene, goal, result, printed, reporter, journal)
    result, printed = best_print.result, best_print.printed
    problem = result.problem
    assert isinstance(problem, ShapeDesign)
    figures: dict[str, Any] = {
        "seed": design.seed if best is None else best.seed,
        "start": "random" if problem.start is None else "pattern",
        "rounds": best_print.rounds,
    }
    if best is not None:
        figures["starts"] = {
            str(seed): value if np.isfinite(value) else None
            for seed, value in best.objectives.items()
        }
    figures.update(_robust_figures(best_print))
    return _written(output, result, printed, scene, figures, reporter)


def _from_lines(
    comm: MPI.Comm,
    output: Path | str,
    scene: ActuatorScene,
    reporter: DesignReporter,
    verbose: bool,
    journal: Journal | None,
) -> ActuatorResult:
    """Design an actuator by line families and write all results (collective)."""
    more, lines = scene.relaxed_options.more_iterations, scene.lines
    reporter.expect(2 * lines.relaxed_iterations + scene.design.corrections * more)
    with reporter:
        found = discover(comm, scene, reporter, verbose=verbose, journal=journal)
        relaxed, better = found.best.relaxed, None
        if lines.density_iterations:
            reporter.expect(relaxed.history[-1].iteration + lines.density_iterations)
            better = _densities(comm, scene, found, reporter, verbose, journal)
    figures: dict[str, Any] = {"seed": scene.design.seed, "start": "random", **found.figures()}
    figures["rounds"] = len(found.rounds) - 1
    figures["densities_kept"] = better is not None
    if better is not None:
        result, printed = better.result, better.printed
        figures.update(_robust_figures(better))
        return _written(output, result, printed, scene, figures, reporter, relaxed)
    result, printed = found.result(), found.best.printed

    def estimate() -> dict[str, Any]:
        return _error_of_lines(comm, scene, found)

    return _written(output, result, printed, scene, figures, reporter, relaxed, estimate)


def _written(
    output: Path | str,
    result: DesignResult,
    printed: PrintedDesign,
    scene: ActuatorScene,
    figures: dict[str, Any],
    reporter: DesignReporter,
    relaxed: RelaxedResult | None = None,
    estimate: Callable[[], dict[str, Any]] | None = None,
) -> ActuatorResult:
    """Write a design, then its error and its curve, then pictures and machine files (collective).

    What took longest to find is on disk first.

    Args:
        output, result, printed, scene, reporter: As they are known by now.
        figures: Further entries of the summary.
        relaxed: The relaxed design that the lines come from; None without lines.
        estimate: Returns the error of the print's metrics; None takes that of a refined mesh.
    """
    problem = result.problem
    assert isinstance(problem, ShapeDesign)

    def write(*, pictures: bool) -> dict[str, Any]:
        return write_results(
            output,
            result,
            printed,
            config=scene,
            figures=figures,
            seconds=reporter.seconds,
            field=None if relaxed is None else relaxed.field,
            start=None if relaxed is None else relaxed.start,
            pictures=pictures,
        )

    def of_refined_mesh() -> dict[str, Any]:
        made = printed.evaluation
        return {} if made is None else _error_of_print(problem, made)

    run = run_of(output)
    steps = [lambda: curve_figures(output, problem, printed, scene, scene.MEASURED)]
    if scene.results.estimate_error:
        steps.insert(0, estimate or of_refined_mesh)
    write(pictures=False)
    for step in steps:
        if run is not None:
            run.check()
        figures.update(step())
    summary, place = write(pictures=True), Path(output) / FOLDER
    pattern, regions = printed.pattern, printed.regions
    write_together(
        problem.skin.comm,
        output,
        lambda: if_possible(lambda: write_manufacture(place, pattern, regions, summary=summary)),
    )
    return ActuatorResult(summary, result, printed, problem)


def summary_sentence(summary: Mapping[str, Any]) -> str:
    """Return the result of a design in one sentence, from its summary."""
    # Where a relaxed design is laid as lines, no design by densities stands beside the print.
    laid = "lines" in summary and not summary["densities_kept"]
    metrics = []
    for key in (key for key in summary if "_target_" in key):
        name, unit = key.split("_target_")
        word, _ = UNITS.get(unit, (unit, ""))
        value, error = (summary.get(f"{name}_{kind}{unit}") for kind in ("", "error_"))
        digits = 3 if unit == "ratio" else 1
        printed = "no equilibrium" if value is None else f"{value:.{digits}f}"
        if error is not None:
            printed += f" ± {error:.{digits}f}"
        designed = f"{summary['design'][f'{name}_{unit}']:.{digits}f}"
        beside = "" if laid else f" ({designed} as designed)"
        metrics.append(f"{name} {printed} of {summary[key]:g} {word} as printed{beside}")
    if "length_ratio" in summary and "length_target_ratio" not in summary:
        length = summary["length_ratio"]
        if length is not None:
            metrics.append(f"length {length:.3f} times the rest value")
    first, last = summary["objective_first"], summary["objective_last"]
    metrics.extend(
        f"nothing to compare with on a {mesh} mesh, so that its error is unknown"
        for mesh in ("refined", "coarser")
        if mesh in summary
    )
    steps = f"objective down {first / last:.0f} times" if last > 0 else f"objective {last:g}"
    if laid:
        rounds = summary["lines"]["rounds"]
        steps = f"lines laid {len(rounds)} times"
    return (
        f"{', '.join(metrics)} at {summary['pressure_pa'] / 1e3:.2f} kPa, {steps}, "
        f"{summary['manufacture']['islands']} islands, {summary['seconds']['total']:.0f} s"
    )


def error_figures(
    solver: EquilibriumSolver,
    density: Floats,
    result: EquilibriumResult,
    metrics: Sequence[Metric],
) -> dict[str, Any]:
    """Return each metric on a refined mesh and its estimated error, by key (collective).

    All are None if the refined mesh has no equilibrium near that of the given one; the key
    "refined" then says why. "error_seconds" is the wall time that this took.

    Args:
        solver: The solver on the given mesh.
        density: Density of this rank's triangles.
        result: Their equilibrium.
        metrics: The metrics.
    """
    if not metrics:
        return {}
    try:
        found = estimate_error(solver, density, result, [m.measure for m in metrics], direct=True)
    except EquilibriumError as caught:  # raised by all ranks or by none
        keys = [f"{m.name}_{kind}_{m.unit}" for m in metrics for kind in ("refined", "error")]
        return {**dict.fromkeys(keys), "refined": str(caught)}
    figures: dict[str, Any] = {"error_seconds": found[0].seconds}
    for metric, estimate in zip(metrics, found, strict=True):
        figures[f"{metric.name}_refined_{metric.unit}"] = estimate.refined
        figures[f"{metric.name}_error_{metric.unit}"] = estimate.error
    return figures


def _error_of_print(problem: ShapeDesign, made: Evaluation) -> dict[str, Any]:
    """Return the error figures of a print (collective)."""
    return error_figures(problem.solver, made.projected, made.equilibrium, problem.metrics)


def _error_of_lines(comm: MPI.Comm, scene: ActuatorScene, found: Discovery) -> dict[str, Any]:
    """Return each metric of laid lines on a coarser mesh and its estimated error (collective).

    The mesh of a print of lines is so fine already that a refined one would take longer than the
    design. All are None if there is no coarser mesh, or no equilibrium on it; the key "coarser"
    then says why.
    """
    metrics, begin = found.problem.metrics, time.perf_counter()
    try:
        ratio, other = metrics_on_coarser_mesh(comm, scene, found)
    except (NoEquilibriumError, ParameterError) as caught:  # raised by all ranks or by none
        keys = [f"{m.name}_{kind}_{m.unit}" for m in metrics for kind in ("coarser", "error")]
        return {**dict.fromkeys(keys), "coarser": str(caught)}
    figures: dict[str, Any] = {"error_seconds": time.perf_counter() - begin}
    caution = 1 / (ratio**ORDER_OF_LINES - 1)
    for metric in metrics:
        value, coarser = found.best.metrics[metric.key], other[metric.key]
        figures[f"{metric.name}_coarser_{metric.unit}"] = coarser
        figures[f"{metric.name}_error_{metric.unit}"] = caution * abs(value - coarser)
    return figures


def _printed_design(
    problems: Iterable[ShapeDesign],
    options: Sequence[DesignOptions],
    scene: ActuatorScene,
    reporter: DesignReporter,
    best: BestStart | None,
    journal: Journal | None,
) -> tuple[DesignResult, PrintedDesign]:
    """Run a level for each of the options, after the best start if there are several (collective).

    Each has a polishing stage if its print has free islands.
    """
    limits = scene.print.limits
    rules_of = dict(enumerate(options, 0 if best is None else 1))
    steps = sum(level.iterations for level in options)
    printed: PrintedDesign | None = None

    def polished(result: DesignResult) -> DesignResult:
        nonlocal steps, printed
        problem = result.problem
        assert isinstance(problem, ShapeDesign)
        printed = as_printed(
            problem, result, limits, island_area=scene.print.island_area, journal=journal
        )
        if not scene.design.polish_iterations or not printed.before.free_islands:
            return result
        rules = rules_of[result.history[-1].level]
        last = replace(rules.stages[-1], iterations=scene.design.polish_iterations)
        start = _without_free_islands(problem, result, printed)
        steps += last.iterations
        reporter.expect(steps)
        result = optimize(
            problem,
            replace(rules, stages=(last,)),
            start=start,
            callback=reporter,
            after=result,
            journal=journal,
        )
        printed = as_printed(
            problem, result, limits, island_area=scene.print.island_area, journal=journal
        )
        return result

    reporter.expect(steps)
    result = optimize_levels(
        problems,
        options,
        seed=scene.design.seed,
        callback=reporter,
        finish=polished,
        after=None if best is None else best.design,
        journal=journal,
    )
    assert printed is not None
    return result, printed


def _densities(
    comm: MPI.Comm,
    scene: ActuatorScene,
    found: Discovery,
    reporter: DesignReporter,
    verbose: bool,
    journal: Journal | None,
) -> _Corrected | None:
    """Design and correct densities from lines; None if the print is not better (collective)."""
    designed = densities_last(comm, scene, found, reporter, verbose=verbose, journal=journal)
    if designed is None:
        return None

    def goal(other: ActuatorScene) -> Case:
        return other.case(comm, scene.density_level).following(comm, found.regions)

    made = _corrected(scene, goal, *designed, reporter, journal)
    if made.printed.evaluation is None:
        return None
    better = largest_error(made.metrics, aims_of(found.problem.metrics)) < found.best.error
    return made if better else None


@dataclass(frozen=True, eq=False)
class _Corrected:
    """A design of other targets than the problem's, and its print; an `Answer`."""

    asked: Mapping[str, float]
    metrics: Mapping[str, float]
    result: DesignResult
    printed: PrintedDesign
    spread: PrintSpread | None
    rounds: int = 0  # number of corrections until the search ended


def _robust_figures(made: _Corrected) -> dict[str, Any]:
    """Return figures of a robust design and of its print with other widths; none of another."""
    problem = made.result.problem
    assert isinstance(problem, ShapeDesign)
    figures = problem.robust_figures(made.result.final)
    if not figures:
        return {}
    both = (None, None) if made.spread is None else made.spread.metrics
    printed = dict(zip(("narrower", "wider"), both, strict=True))
    return {"robust": {**figures, "printed": printed}}


def _corrected(
    scene: ActuatorScene,
    goal: Callable[[ActuatorScene], Case],
    result: DesignResult,
    printed: PrintedDesign,
    reporter: DesignReporter,
    journal: Journal | None,
) -> _Corrected:
    """Ask the design for what its print misses, and return the best print (collective).

    The design is continued on the finest mesh with targets beyond those of the problem. Metrics
    whose target no field holds only count for which print is best. Near the targets a correction
    that hardly helps is the last. A robust design is told how far its prints are apart; of those
    that are close to the targets the one with the least spread is best.

    Args:
        scene: What was designed.
        goal: Returns the case of a scene of other targets on the finest mesh (collective).
        result, printed: The design there, and its print.
        reporter, journal: As of the whole design.
    """
    problem = result.problem
    assert isinstance(problem, ShapeDesign)
    aims = aims_of(problem.metrics)
    free = {key: aim for key, aim in aims.items() if key in scene.TARGETS}

    def answer(asked: Mapping[str, float], of: DesignResult, made: PrintedDesign) -> _Corrected:
        found = made.evaluation
        metrics = {} if found is None else problem.metrics_of(found.equilibrium)
        spread = None
        if robust is not None:
            spread = print_spread(problem, made, robust.tolerance.offset)
        return _Corrected(asked, metrics, of, made, spread)

    def clean(made: _Corrected) -> bool:
        before = made.printed.before
        return not (before.narrow_lines or before.narrow_gaps or before.free_islands)

    def badness(made: _Corrected) -> tuple[float, float]:
        error = largest_error(made.metrics, aims) + (not clean(made)) * UNCLEAN
        if robust is None:
            return error, 0.0
        scales = {key: aim.scale for key, aim in aims.items()}
        return max(error, CLOSE), np.inf if made.spread is None else made.spread.error(scales)

    robust = problem.robust
    rounds = [answer({key: aim.target for key, aim in free.items()}, result, printed)]
    for _ in range(scene.design.corrections if free else 0):
        last = rounds[-1]
        close = largest_error(last.metrics, aims) < CLOSE and clean(last)
        if not last.metrics or (close and robust is None):
            break
        asked = dict(last.asked) if close else asked_next(rounds, free)
        try:
            other = scene.asked(asked)
        except ParameterError:  # beyond what the targets' fields allow
            break
        reporter.expect(last.result.history[-1].iteration + scene.design.level_iterations)
        asking = problem.towards(goal(other))
        if last.spread is not None:
            asking = asking.with_printed_spread(last.spread.half, last.result.final)
        found = optimize(
            asking,
            scene.design.finer_options,
            callback=reporter,
            after=last.result,
            journal=journal,
        )
        made = as_printed(
            problem,
            found,
            scene.print.limits,
            island_area=scene.print.island_area,
            journal=journal,
        )
        final = replace(
            found.final, shape=problem.objective.forward(found.final.equilibrium.positions)
        )
        rounds.append(answer(asked, replace(found, problem=problem, final=final), made))
        (before, _), (now, _) = min(map(badness, rounds[:-1])), badness(rounds[-1])
        if robust is None and now > HELPS * before and min(now, before) < FINE:
            break
    return replace(min(rounds, key=badness), rounds=len(rounds) - 1)


def _without_free_islands(
    problem: ShapeDesign, result: DesignResult, printed: PrintedDesign
) -> Floats:
    """Remove the free islands or join them to the rest, whichever does less harm (collective)."""
    starts = [change(problem, result, printed) for change in (remove_islands, connect_islands)]
    objectives = []
    for density in starts:
        try:
            near = result.final.equilibrium
            found = problem.simulate(density, near.state, near.pressures, trial=True)
            objectives.append(found.objective)
        except EquilibriumError:  # raised by all ranks or by none
            objectives.append(np.inf)
    return starts[int(np.argmin(objectives))]
