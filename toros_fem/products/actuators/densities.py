"""Design of densities over meshes, from coarse to fine, and again for what their print misses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from toros_fem.base.mpi import free_dropped, on_first_rank
from toros_fem.design.loop.carried import CarriedDesign
from toros_fem.design.loop.levels import optimize_levels
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import LOST, DesignOptions, Stage, growth_of_miss
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.as_printed.free_islands import patterns_without_islands
from toros_fem.products.actuators.corrections import corrected
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.trim import worst_of_print
from toros_fem.results.reporter import DesignReporter

# A print whose worst figure is off by so many tolerances is not tried without its islands.
FAR = 10.0
# Designs again from another pattern without islands (collective).
Polish = Callable[[], DesignResult]
# How far another seed is from the one that was given.
ANOTHER_SEED = 1000


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
    ) -> tuple[tuple[DesignResult, PrintedDesign], list[Polish]]:
        """Run a level for each of the options, after a design of another mesh if there is one.

        Each has a polishing stage if its print has free islands, from the best pattern without
        them. Functions that polish the last level from other ones are returned too. None takes the
        scene's seed.
        """
        rules_of = dict(enumerate(options, 0 if after is None else after.level))
        steps = sum(level.iterations for level in options)
        printed: PrintedDesign | None = None
        others: list[Polish] = []

        def finished(result: DesignResult) -> DesignResult:
            nonlocal steps, printed
            others.clear()
            printed = made = self.print_of(result)
            polishing = self.scene.design.polish_iterations
            if not polishing or not on_first_rank(self.comm, lambda: len(made.before.free_islands)):
                return result
            rules = rules_of[result.history[-1].level]
            last = replace(rules.stages[-1], iterations=polishing)
            steps += last.iterations
            self.reporter.expect(steps)
            rules = replace(rules, stages=(last,))
            polish = partial(optimize, result.problem, rules, callback=self.reporter, after=result)
            best, *rest = patterns_without_islands(result, made)
            others.extend(
                partial(polish, start=start, journal=self.branch(f"polish-{number}"))
                for number, start in enumerate(rest, 2)
            )
            result = polish(start=best, journal=self.branch("polish"))
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
        return (result, printed), others

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
        result: DesignResult,
        printed: PrintedDesign,
        print_of: Callable[[DesignResult], PrintedDesign] | None = None,
        branch: str = "correction",
    ) -> tuple[DesignResult, PrintedDesign, int]:
        """Return a design and its print after corrections, and the number of these.

        None makes prints as of `print_of`. The journal has a branch of its own.
        """
        rounds, make = 0, print_of or self.print_of

        def expect(last: DesignResult) -> None:
            more = last.history[-1].iteration + self.scene.design.level_iterations
            self.reporter.expect(more)

        def print_again(again: DesignResult) -> PrintedDesign:
            nonlocal rounds
            rounds += 1
            expect(again)
            return make(again)

        expect(result)
        found = corrected(
            result,
            printed,
            self.scene.design.finer_options,
            print_again=print_again,
            rounds=self.scene.design.corrections,
            tolerances=self.scene.results.tolerances,
            callback=self.reporter,
            journal=self.branch(branch),
        )
        return *found, rounds


def other_ways(
    options: Sequence[DesignOptions], seed: int, beta: float
) -> Iterator[tuple[str, tuple[DesignOptions, ...], int]]:
    """Yield other ways to a design whose stage with widths lost the shape: name, options, seed."""
    first, finer = options[0], tuple(options[1:])
    *free, last = first.stages
    if not last.constrained:
        return
    softer = replace(last, iterations=2 * last.iterations, tighten=math.sqrt(last.tighten))
    sharper = Stage(max(1, last.iterations // 3), beta=2 * beta), last
    yield "softer constraints", (replace(first, stages=(*free, softer)), *finer), seed
    yield "a sharper projection first", (replace(first, stages=(*free, *sharper)), *finer), seed
    yield "another seed", tuple(options), seed + ANOTHER_SEED


def problem_of(result: DesignResult) -> ShapeDesign:
    """Return the problem of a design of shapes."""
    problem = result.problem
    assert isinstance(problem, ShapeDesign)
    return problem
