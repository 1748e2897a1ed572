"""Design of densities over meshes, from coarse to fine, and again for what their print misses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import free_dropped, on_first_rank
from toros_fem.design.loop.carried import CarriedDesign
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.corrections import correct
from toros_fem.design.loop.levels import optimize_levels
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import LOST, DesignOptions, Stage, growth_of_miss
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.as_printed.free_islands import polished
from toros_fem.making.as_printed.print_spread import PrintSpread, print_spread
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.space_mapping import (
    CLOSE,
    FINE,
    HELPS,
    aims_of,
    asked_next,
    follows,
    largest_error,
)
from toros_fem.products.actuators.trim import worst_of_print
from toros_fem.results.reporter import DesignReporter

if TYPE_CHECKING:  # a scene is designed by what imports this
    from toros_fem.products.actuators.scene import ActuatorScene

# Error of a metric that is as bad as a design whose contours have islands, or lines or gaps that
# cannot be printed, before they are cleaned.
UNCLEAN = 0.02
# A print whose worst figure is off by so many tolerances is not tried without its islands.
FAR = 10.0
# How far another seed is from the one that was given.
ANOTHER_SEED = 1000


@dataclass(frozen=True, eq=False)
class Attempt:
    """A design that was asked for targets, perhaps beyond those of the problem, and its print.

    Attributes:
        asked: Targets that were asked, by the keys of their metrics.
        metrics: Metrics of the print, by key; empty without an equilibrium.
        result: The design, with the objective of the problem itself.
        spread: How far prints with other widths are apart; None if the design is not robust.
    """

    asked: Mapping[str, float]
    metrics: Mapping[str, float]
    result: DesignResult
    printed: PrintedDesign
    spread: PrintSpread | None

    @property
    def problem(self) -> ShapeDesign:
        """The problem of the design."""
        return problem_of(self.result)

    @property
    def robust(self) -> dict[str, Any] | None:
        """Figures of a robust design and of its print with other widths; None of another."""
        final, problem = self.result.final, self.problem
        if problem.robust is None or final.spread is None:
            return None
        metrics = [problem.metrics_of(variant) for variant in final.variants]
        figures = problem.robust.figures(final.spread, metrics)
        both = (None, None) if self.spread is None else self.spread.metrics
        return {**figures, "printed": dict(zip(("narrower", "wider"), both, strict=True))}

    @property
    def clean(self) -> bool:
        """Whether the contours can be printed before they are cleaned."""

        def found() -> bool:
            before = self.printed.before
            return not (before.lines.narrow or before.gaps.narrow or before.free_islands)

        return on_first_rank(self.problem.comm, found)


@dataclass(frozen=True, eq=False, kw_only=True)
class DensityDesigner(Job):
    """The design of densities, to the print that is best; all methods are collective.

    Attributes:
        reporter: Reports the progress.
    """

    reporter: DesignReporter

    def over_levels(
        self,
        problems: Iterator[ShapeDesign],
        options: Sequence[DesignOptions],
        after: CarriedDesign | None = None,
        seed: int | None = None,
    ) -> tuple[DesignResult, PrintedDesign]:
        """Run a level for each of the options, after a design of another mesh if there is one.

        Each has a polishing stage if its print has free islands. None takes the scene's seed.
        """
        rules_of = dict(enumerate(options, 0 if after is None else after.level))
        steps = sum(level.iterations for level in options)
        printed: PrintedDesign | None = None

        def finished(result: DesignResult) -> DesignResult:
            nonlocal steps, printed
            printed = made = self.print_of(result)
            polishing = self.scene.design.polish_iterations
            if not polishing or not on_first_rank(self.comm, lambda: len(made.before.free_islands)):
                return result
            rules = rules_of[result.history[-1].level]
            last = replace(rules.stages[-1], iterations=polishing)
            steps += last.iterations
            self.reporter.expect(steps)
            last_rules, journal = replace(rules, stages=(last,)), self.branch("polish")
            result = polished(result, made, last_rules, callback=self.reporter, journal=journal)
            printed = self.print_of(result)
            return result

        self.reporter.expect(steps)
        result = optimize_levels(
            problems,
            options,
            seed=self.scene.design.seed if seed is None else seed,
            callback=self.reporter,
            finish=finished,
            after=after,
            journal=self.journal,
        )
        assert printed is not None
        return result, printed

    def worst(self, printed: PrintedDesign) -> float:
        """Return the largest miss of a figure over its tolerance, as of `worst_of_print`."""
        return worst_of_print(printed, self.scene.results.tolerances)

    def lost(self, result: DesignResult, printed: PrintedDesign) -> bool:
        """Return whether a print misses because the stages with widths lost the shape."""
        return growth_of_miss(result.history, result.final.shape) > LOST and self.worst(printed) > 1

    def print_of(self, result: DesignResult) -> PrintedDesign:
        """Return the print of a design, simulated at the pressure that suits it best.

        Where it misses, but not by far, and islands were bridged, it is tried without them.
        """
        printer = self.scene.print

        def printed(island_area: float) -> PrintedDesign:
            problem = problem_of(result)
            found = as_printed(
                problem, result, printer.limits, island_area=island_area, journal=self.journal
            )
            return self.trimmed(found)

        made = printed(printer.island_area)
        if made.cleaned.bridged and 1 < (worst := self.worst(made)) < FAR:
            other = printed(math.inf)
            if self.worst(other) < worst:
                return other
            del other
            free_dropped(self.comm)
        return made

    def corrected(
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
        scene, problem = self.scene, problem_of(result)
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
                both = attempts[-2:]
                designed = [one.result.history[-1].metrics for one in both]
                if hardly or not follows(designed, [one.asked for one in both], free):
                    return True
            return close(last)

        def again(attempts: Sequence[Attempt]) -> Attempt | None:
            last = attempts[-1]
            asked = dict(last.asked)
            if not close(last):
                asked = asked_next([a.metrics for a in attempts], [a.asked for a in attempts], free)
            try:
                other = scene.asked(asked)
            except ParameterError:  # beyond what the targets' fields allow
                return None
            steps = last.result.history[-1].iteration + scene.design.level_iterations
            self.reporter.expect(steps)
            asking = problem.towards(goal(other))
            if last.spread is not None and last.printed.evaluation is not None:
                on, skin = last.printed.evaluation.problem.skin, problem.skin
                half = make_transfer(on.pattern, skin.pattern).at_vertices(last.spread.half)
                half = half[skin.owned_vertices]
                seen = [variant.positions for variant in last.result.final.variants]
                assert asking.robust is not None
                asking = asking.changed(robust=asking.robust.corrected(half, *seen))
            found = optimize(
                asking,
                scene.design.finer_options,
                callback=self.reporter,
                after=last.result,
                journal=self.branch("correction"),
            )
            shape = problem.objective.forward(found.final.equilibrium.positions)
            found = replace(found, problem=problem, final=replace(found.final, shape=shape))
            return _attempt(asked, found, self.print_of(found))

        first = _attempt({key: aim.target for key, aim in free.items()}, result, printed)
        return correct(first, again, enough, scene.design.corrections if free else 0)

    def best(self, attempts: Sequence[Attempt]) -> Attempt:
        """Return the attempt whose print is nearest to the targets.

        Of robust designs that are close to them, it is the one with the least spread.
        """
        problem = attempts[0].problem
        scales = {key: aim.scale for key, aim in aims_of(problem.metrics).items()}

        def badness(attempt: Attempt) -> tuple[float, float]:
            if problem.robust is None:
                return _error(attempt), 0.0
            spread = np.inf if attempt.spread is None else attempt.spread.error(scales)
            return max(_error(attempt), CLOSE), spread

        return min(attempts, key=badness)


def other_ways(
    options: Sequence[DesignOptions], seed: int, beta: float
) -> Iterator[tuple[str, tuple[DesignOptions, ...], int]]:
    """Yield other ways to a design whose stage with widths lost the shape: name, options, seed."""
    first, finer = options[0], tuple(options[1:])
    *free, last = first.stages
    if not last.constrained:
        return
    softer = replace(last, iterations=2 * last.iterations, tighten=math.sqrt(last.tighten))
    sharper = Stage(max(1, last.iterations // 3), beta=2 * beta, robust=False), last
    yield "softer constraints", (replace(first, stages=(*free, softer)), *finer), seed
    yield "a sharper projection first", (replace(first, stages=(*free, *sharper)), *finer), seed
    yield "another seed", tuple(options), seed + ANOTHER_SEED


def problem_of(result: DesignResult) -> ShapeDesign:
    """Return the problem of a design of shapes."""
    problem = result.problem
    assert isinstance(problem, ShapeDesign)
    return problem


def _attempt(asked: Mapping[str, float], result: DesignResult, printed: PrintedDesign) -> Attempt:
    """Return a design with the metrics of its print and, of a robust one, the spread."""
    problem, metrics, spread = problem_of(result), printed.metrics, None
    if problem.robust is not None:
        spread = print_spread(printed, problem.robust.tolerance.offset)
    return Attempt(asked, metrics, result, printed, spread)


def _error(attempt: Attempt) -> float:
    """Return the largest error of a metric, more if the contours have to be cleaned."""
    aims = aims_of(attempt.problem.metrics)
    return largest_error(attempt.metrics, aims) + (not attempt.clean) * UNCLEAN
