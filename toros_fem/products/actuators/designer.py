"""Design of an actuator from start to files: optimise, print, correct, estimate, write."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.files import guarded, if_possible
from toros_fem.base.mpi import Distributed, collective
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.corrections import correct
from toros_fem.design.loop.levels import optimize_levels
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.starts import BestStart, best_start
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.as_printed.free_islands import connect_islands, remove_islands
from toros_fem.making.as_printed.print_spread import PrintSpread, print_spread
from toros_fem.making.sheets.write import FOLDER, write_manufacture
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.readings.error_estimate import limit_shape
from toros_fem.products.actuators.cost import require_affordable_meshes
from toros_fem.products.actuators.discovery import Discovery, densities_from, discover
from toros_fem.products.actuators.estimates import MetricErrors, metric_errors
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.pressure_curve import write_curve
from toros_fem.products.actuators.result import ActuatorResult, Search
from toros_fem.products.actuators.space_mapping import (
    CLOSE,
    FINE,
    HELPS,
    Aim,
    aims_of,
    asked_next,
    largest_error,
)
from toros_fem.products.plausibility import doubts
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.result import write_summary
from toros_fem.results.runs.folder import journal_of, run_of
from toros_fem.results.shape_miss import quantities_of, shape_of
from toros_fem.results.summary import PrintedResult, printed_metrics
from toros_fem.results.writer import draw_pictures, write_design

if TYPE_CHECKING:  # a scene is designed here, and says so
    from toros_fem.products.actuators.scene import ActuatorScene

log = logging.getLogger(__name__)

# Error of a metric that is as bad as a design whose contours have islands, or lines or gaps that
# cannot be printed, before they are cleaned.
UNCLEAN = 0.02
# A design that changes by less than this part of what was asked beyond the last is at its limit.
FOLLOWS = 0.25


@dataclass(frozen=True, eq=False)
class Attempt:
    """A design that was asked for targets, perhaps beyond those of the problem, and its print.

    Attributes:
        asked: Targets that were asked, by the keys of their metrics.
        metrics: Metrics of the print, by key; empty without an equilibrium.
        result: The design, with the objective of the problem itself.
        printed: Its print.
        spread: How far prints with other widths are apart; None if the design is not robust.
    """

    asked: Mapping[str, float]
    metrics: Mapping[str, float]
    result: DesignResult
    printed: PrintedDesign
    spread: PrintSpread | None

    def follows(self, before: Attempt, aims: Mapping[str, Aim]) -> bool:
        """Return whether the design has changed with what was asked since an attempt before it."""
        designed, earlier = (one.result.history[-1].metrics for one in (self, before))
        changes = [
            float(np.linalg.norm([(now[key] - then[key]) / aims[key].scale for key in aims]))
            for now, then in ((designed, earlier), (self.asked, before.asked))
        ]
        return changes[0] >= FOLLOWS * changes[1]

    @property
    def clean(self) -> bool:
        """Whether the contours can be printed before they are cleaned."""
        before = self.printed.before
        return not (before.narrow_lines or before.narrow_gaps or before.free_islands)


@collective("comm", owned=("journal",))
@dataclass(frozen=True, eq=False, kw_only=True)
class Designer(Distributed, Job):
    """The design of an actuator, from start to files; all methods are collective.

    Attributes:
        reporter: Reports the progress.
        output: Folder for summary, history, pattern, fields and pictures.
    """

    reporter: DesignReporter
    output: Path | str

    def design(self) -> ActuatorResult:
        """Design, and write all results."""
        doubtful = doubts(self.scene)
        if self.comm.rank == 0:
            for one in doubtful:
                log.warning("%s", one)
        require_affordable_meshes(self.comm, self.scene)
        if self.scene.design.start == "relaxed":
            return self._from_lines()
        return self._from_densities()

    def _from_densities(self) -> ActuatorResult:
        """Design densities on each level, from coarse to fine, and correct the last ones."""
        comm, scene, design = self.comm, self.scene, self.scene.design
        levels, options, best = scene.levels, scene.options, None
        if design.starts > 1:
            best = self._best_start()
            # With one mesh alone all ranks finish the best design on it.
            levels, options = levels[1:] or levels, options[1:] or (design.finer_options,)

        def problems() -> Iterator[ShapeDesign]:
            for level in levels:
                yield self.problem(scene.case(comm, level), level)

        with self.reporter:
            made = self._over_levels(problems(), options, best)
            attempts = self._corrected(lambda other: other.case(comm, levels[-1]), *made)
        chosen = self._best(attempts)
        problem = _problem(chosen.result)
        search = Search(
            design.seed if best is None else best.seed,
            "random" if problem.fields.centre is None else "pattern",
            len(attempts) - 1,
            None if best is None else best.objectives,
            _robust_figures(chosen),
        )
        return self._written(chosen.result, chosen.printed, search)

    def _from_lines(self) -> ActuatorResult:
        """Design line families, lay them as lines, and design densities from these last."""
        scene, lines = self.scene, self.scene.lines
        more = scene.relaxed_options.more_iterations
        self.reporter.expect(2 * lines.relaxed_iterations + scene.design.corrections * more)
        with self.reporter:
            found = discover(self)
            relaxed, better = found.best.relaxed, None
            if lines.density_iterations:
                self.reporter.expect(relaxed.history[-1].iteration + lines.density_iterations)
                better = self._densities(found)
        search = Search(
            scene.design.seed,
            "relaxed",
            len(found.rounds) - 1,
            robust=None if better is None else _robust_figures(better),
            lines=found,
            densities_kept=better is not None,
        )
        if better is not None:
            return self._written(better.result, better.printed, search)
        return self._written(found.result(), found.made.printed, search)

    def _best_start(self) -> BestStart:
        """Return the best of several starts on the coarsest mesh, each rank trying its own."""
        scene, design, level = self.scene, self.scene.design, self.scene.levels[0]
        best = best_start(
            self.comm,
            lambda alone: scene.problem(alone, scene.case(alone, level), level),
            scene.options[0],
            range(design.seed, design.seed + design.starts),
            self.journal,
        )
        for row in best.design.history:
            self.reporter.report(row)
        return best

    def _over_levels(
        self,
        problems: Iterator[ShapeDesign],
        options: Sequence[DesignOptions],
        best: BestStart | None,
    ) -> tuple[DesignResult, PrintedDesign]:
        """Run a level for each of the options, after the best start if there are several.

        Each has a polishing stage if its print has free islands.
        """
        rules_of = dict(enumerate(options, 0 if best is None else 1))
        steps = sum(level.iterations for level in options)
        printed: PrintedDesign | None = None

        def polished(result: DesignResult) -> DesignResult:
            nonlocal steps, printed
            printed = self._print(result)
            polishing = self.scene.design.polish_iterations
            if not polishing or not printed.before.free_islands:
                return result
            rules = rules_of[result.history[-1].level]
            last = replace(rules.stages[-1], iterations=polishing)
            steps += last.iterations
            self.reporter.expect(steps)
            result = optimize(
                result.problem,
                replace(rules, stages=(last,)),
                start=_without_free_islands(result, printed),
                callback=self.reporter,
                after=result,
                journal=self.journal,
            )
            printed = self._print(result)
            return result

        self.reporter.expect(steps)
        result = optimize_levels(
            problems,
            options,
            seed=self.scene.design.seed,
            callback=self.reporter,
            finish=polished,
            after=None if best is None else best.design,
            journal=self.journal,
        )
        assert printed is not None
        return result, printed

    def _print(self, result: DesignResult) -> PrintedDesign:
        """Return the print of a design, simulated."""
        printer = self.scene.print
        return as_printed(
            _problem(result),
            result,
            printer.limits,
            island_area=printer.island_area,
            journal=self.journal,
        )

    def _densities(self, found: Discovery) -> Attempt | None:
        """Design and correct densities from lines; None if the print is not better."""
        comm, scene = self.comm, self.scene
        designed = densities_from(self, found)
        if designed is None:
            return None

        def goal(other: ActuatorScene) -> Case:
            return other.case(comm, scene.density_level).following(comm, found.made.regions)

        chosen = self._best(self._corrected(goal, designed, self._print(designed)))
        aims = aims_of(found.made.problem.metrics)
        return chosen if largest_error(chosen.metrics, aims) < found.best.error else None

    def _corrected(
        self,
        goal: Callable[[ActuatorScene], Case],
        result: DesignResult,
        printed: PrintedDesign,
    ) -> list[Attempt]:
        """Ask the design again and again for what its print misses, and return all attempts.

        The design is continued on the finest mesh with targets beyond those of the problem. Metrics
        whose target no field holds only count for which print is best. Near the targets a
        correction that hardly helps is the last, and so is one that the design does not follow. A
        robust design is told how far its prints are apart.

        Args:
            goal: Returns the case of a scene of other targets on the finest mesh.
            result, printed: The design there, and its print.
        """
        scene, problem = self.scene, _problem(result)
        aims = aims_of(problem.metrics)
        free = {key: aim for key, aim in aims.items() if key in scene.targets()}

        def close(attempt: Attempt) -> bool:
            return largest_error(attempt.metrics, aims) < CLOSE and attempt.clean

        def enough(attempts: Sequence[Attempt]) -> bool:
            last = attempts[-1]
            if not last.metrics or problem.robust is not None:
                return not last.metrics
            if len(attempts) > 1:
                now, before = _error(last), min(map(_error, attempts[:-1]))
                hardly = now > HELPS * before and min(now, before) < FINE
                if hardly or not last.follows(attempts[-2], free):
                    return True
            return close(last)

        def again(attempts: Sequence[Attempt]) -> Attempt | None:
            last = attempts[-1]
            asked = dict(last.asked) if close(last) else asked_next(attempts, free)
            try:
                other = scene.asked(asked)
            except ParameterError:  # beyond what the targets' fields allow
                return None
            steps = last.result.history[-1].iteration + scene.design.level_iterations
            self.reporter.expect(steps)
            asking = problem.towards(goal(other))
            if last.spread is not None:
                seen = [variant.positions for variant in last.result.final.variants]
                assert asking.robust is not None
                asking = asking.changed(
                    robust=asking.robust.corrected(
                        last.spread.half[problem.skin.owned_vertices], *seen
                    )
                )
            found = optimize(
                asking,
                scene.design.finer_options,
                callback=self.reporter,
                after=last.result,
                journal=self.journal,
            )
            shape = problem.objective.forward(found.final.equilibrium.positions)
            found = replace(found, problem=problem, final=replace(found.final, shape=shape))
            return _attempt(asked, found, self._print(found))

        first = _attempt({key: aim.target for key, aim in free.items()}, result, printed)
        return correct(first, again, enough, scene.design.corrections if free else 0)

    def _best(self, attempts: Sequence[Attempt]) -> Attempt:
        """Return the attempt whose print is nearest to the targets.

        Of robust designs that are close to them, it is the one with the least spread.
        """
        problem = _problem(attempts[0].result)
        scales = {key: aim.scale for key, aim in aims_of(problem.metrics).items()}

        def badness(attempt: Attempt) -> tuple[float, float]:
            if problem.robust is None:
                return _error(attempt), 0.0
            spread = np.inf if attempt.spread is None else attempt.spread.error(scales)
            return max(_error(attempt), CLOSE), spread

        return min(attempts, key=badness)

    def _written(
        self, result: DesignResult, printed: PrintedDesign, search: Search
    ) -> ActuatorResult:
        """Write a design and its summary, then error, curve, machine files, trial and pictures.

        What took longest to find is on disk first. The last summary has all of them.
        """
        scene, folder = self.scene, Path(self.output)
        metrics = printed_metrics(result, printed)
        made = PrintedResult(
            result,
            printed,
            metrics,
            config=scene,
            shape=shape_of(printed.evaluation),
            tolerances=scene.results.tolerances,
        )
        found = self._write(ActuatorResult(made, search, corrections=scene.design.corrections))
        write_summary(self.comm, folder, found)
        if scene.results.estimate_error:
            self._check()
            errors = self._errors(found)
            if errors is not None:
                made = replace(made, intervals=errors.intervals)
            found = replace(found, made=made, errors=errors)
        self._check()
        curve = write_curve(self.comm, folder, printed, scene.results, scene.MEASURED)
        found = self._write(replace(found, curve=curve))
        summary, place = found.summary(), folder / FOLDER
        pattern, regions = printed.pattern, printed.regions
        guarded(
            self.comm,
            folder,
            lambda: if_possible(
                "machine files",
                lambda: write_manufacture(place, pattern, regions, summary=summary),
            ),
        )
        found = replace(found, trial=scene.trial(self.comm, folder, found))
        write_summary(self.comm, folder, found)
        draw_pictures(self.comm, folder, lambda: _draw_lines(folder, found))
        return found

    def _check(self) -> None:
        """Stop here if the run was asked to stop."""
        run = run_of(self.output)
        if run is not None:
            run.check()

    def _write(self, found: ActuatorResult) -> ActuatorResult:
        """Write a design and return it with the time that it took until now."""
        found = replace(found, made=replace(found.made, seconds=dict(self.reporter.seconds)))
        write_design(self.output, found.made)
        return found

    def _errors(self, found: ActuatorResult) -> MetricErrors | None:
        """Return the errors of the metrics of a print; None without an equilibrium."""
        printed = found.made.printed
        made = printed.evaluation
        if made is None:
            return None
        problem, lines = made.problem, self.scene.design.start == "relaxed"
        assert isinstance(problem, ShapeDesign)
        keys = list(found.made.shape)
        measures = {metric.key: metric.measure for metric in problem.metrics}
        measures |= dict(zip(keys, quantities_of(problem, keys), strict=True))
        shape = limit_shape(problem.solver, made.equilibrium)
        level = self.scene.print_level if lines else self.scene.finest_level
        regions, pressures = (printed.pattern, printed.regions), made.equilibrium.pressures
        return metric_errors(self, level, shape, measures, regions, pressures)


def _draw_lines(folder: Path, found: ActuatorResult) -> None:
    """Draw the line families that a design was made of, if it was (one rank)."""
    from toros_fem.results.pictures.flat import draw_lines
    from toros_fem.results.pictures.style import page

    lines, printed = found.search.lines, found.made.printed
    if lines is not None and lines.best.relaxed is not None:
        with page(folder / "lines.png") as figure:
            draw_lines(figure, lines.best.relaxed.field, printed.pattern, printed.regions)


@collective("comm")
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
    place of the first level; its islands are left to the next. The design is asked again for what
    its print misses, `corrections` times at most.

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
    designer = Designer(
        comm=comm,
        scene=scene,
        output=output,
        reporter=reporter or DesignReporter(comm, output),
        journal=journal_of(output),
        verbose=verbose,
    )
    return designer.design()


def _problem(result: DesignResult) -> ShapeDesign:
    problem = result.problem
    assert isinstance(problem, ShapeDesign)
    return problem


def _attempt(asked: Mapping[str, float], result: DesignResult, printed: PrintedDesign) -> Attempt:
    """Return a design with the metrics of its print and, of a robust one, the spread."""
    problem, metrics, spread = _problem(result), printed.metrics, None
    if problem.robust is not None:
        spread = print_spread(printed, problem.robust.tolerance.offset)
    return Attempt(asked, metrics, result, printed, spread)


def _error(attempt: Attempt) -> float:
    """Return the largest error of a metric, more if the contours have to be cleaned."""
    aims = aims_of(_problem(attempt.result).metrics)
    return largest_error(attempt.metrics, aims) + (not attempt.clean) * UNCLEAN


def _robust_figures(made: Attempt) -> dict[str, Any] | None:
    """Return figures of a robust design and of its print with other widths; None of another."""
    final, problem = made.result.final, _problem(made.result)
    if problem.robust is None or final.spread is None:
        return None
    metrics = [problem.metrics_of(variant) for variant in final.variants]
    figures = problem.robust.figures(final.spread, metrics)
    both = (None, None) if made.spread is None else made.spread.metrics
    return {**figures, "printed": dict(zip(("narrower", "wider"), both, strict=True))}


def _without_free_islands(result: DesignResult, printed: PrintedDesign) -> Floats:
    """Remove the free islands or join them to the rest, whichever does less harm (collective)."""
    problem, near = _problem(result), result.final.equilibrium
    starts = [change(problem, result, printed) for change in (remove_islands, connect_islands)]
    objectives = []
    for density in starts:
        try:
            found = problem.simulate(density, near.state, near.pressures, trial=True)
            objectives.append(found.objective)
        except EquilibriumError:  # raised by all ranks or by none
            objectives.append(np.inf)
    return starts[int(np.argmin(objectives))]
