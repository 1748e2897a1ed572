"""Design of densities over meshes, from coarse to fine, and again for what their print misses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from toros_fem.base.mpi import free_dropped, on_first_rank
from toros_fem.design.loop.carried import CarriedDesign
from toros_fem.design.loop.levels import optimize_levels
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import LOST, DesignOptions, Stage, growth_of_miss
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign, as_printed
from toros_fem.making.as_printed.free_islands import polished
from toros_fem.making.as_printed.print_spread import PrintSpread, print_spread
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.space_mapping import HELPS, aims_of
from toros_fem.products.actuators.trim import SHARE, worst_of_print
from toros_fem.results.reporter import DesignReporter

# A print whose worst figure is off by this part of its tolerance is good enough.
GOOD = 0.25
# A print whose worst figure is off by so many tolerances is not tried without its islands.
FAR = 10.0
# How far another seed is from the one that was given.
ANOTHER_SEED = 1000


@dataclass(frozen=True, eq=False)
class Attempt:
    """A design and its print.

    Attributes:
        worst: Largest miss of a figure of the print over its tolerance, as of `worst_of_print`.
        result: The design, with the objective of the problem itself.
        spread: How far prints with other widths are apart; None if the design is not robust.
    """

    worst: float
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

    def corrected(self, result: DesignResult, printed: PrintedDesign) -> list[Attempt]:
        """Design again and again for what the print misses, and return all attempts.

        The design goes on on its mesh, towards a target that is moved, vertex by vertex, by what
        the design has beyond its print (output space mapping, Bandler et al. 2004). Pressures are
        free as far as a print is trimmed. This ends once the print is good, or once the worst
        figure over its tolerance has hardly fallen. A robust design is told how far its prints are
        apart.

        Args:
            result, printed: A design, and its print.
        """
        attempts = [self._attempt(result, printed)]
        for _ in range(self.scene.design.corrections):
            last = attempts[-1]
            hardly = len(attempts) > 1 and last.worst > HELPS * attempts[-2].worst
            if last.worst <= GOOD or last.printed.evaluation is None or hardly:
                break
            attempts.append(self._again(last))
            free_dropped(self.comm)
        return attempts

    def _again(self, last: Attempt) -> Attempt:
        """Return the attempt that asks for what the print of the last one missed."""
        problem, design, made = last.problem, last.result.final, last.printed.evaluation
        assert made is not None
        own, skin = design.equilibrium, problem.skin
        mesh = make_transfer(made.problem.skin.pattern, skin.pattern)
        there = mesh.positions(made.problem.physics.shape_of(made.equilibrium))
        beyond = problem.physics.shape_of(own) - there
        asking = problem.towards(replace(problem.case, target=problem.case.goal + beyond))
        bounds = [
            given if given is None else (max(given[0], (1 - SHARE) * at),
                                         min(given[1], (1 + SHARE) * at))
            for given, at in zip(problem.physics.pressure_ranges, own.pressures, strict=True)
        ]  # fmt: skip
        physics = replace(problem.physics, pressure=own.pressures, pressure_bounds=bounds)
        asking = asking.changed(physics=physics)
        if last.spread is not None:
            half = mesh.at_vertices(last.spread.half)[skin.owned_vertices]
            seen = [variant.positions for variant in design.variants]
            assert asking.robust is not None
            asking = asking.changed(robust=asking.robust.corrected(half, *seen))
        steps = last.result.history[-1].iteration + self.scene.design.level_iterations
        self.reporter.expect(steps)
        found = optimize(
            asking,
            self.scene.design.finer_options,
            callback=self.reporter,
            after=last.result,
            journal=self.branch("correction"),
        )
        shape = problem.objective.forward(found.final.equilibrium.positions)
        found = replace(found, problem=problem, final=replace(found.final, shape=shape))
        return self._attempt(found, self.print_of(found))

    def _attempt(self, result: DesignResult, printed: PrintedDesign) -> Attempt:
        """Return a design with its print's worst figure and, of a robust one, the spread."""
        robust, spread = problem_of(result).robust, None
        if robust is not None:
            spread = print_spread(printed, robust.tolerance.offset)
        return Attempt(self.worst(printed), result, printed, spread)

    def best(self, attempts: Sequence[Attempt]) -> Attempt:
        """Return the attempt whose print is nearest to the targets.

        Of robust designs that are good, it is the one with the least spread.
        """
        problem = attempts[0].problem
        scales = {key: aim.scale for key, aim in aims_of(problem.metrics).items()}

        def badness(attempt: Attempt) -> tuple[float, float]:
            if problem.robust is None:
                return attempt.worst, 0.0
            spread = np.inf if attempt.spread is None else attempt.spread.error(scales)
            return max(attempt.worst, GOOD), spread

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
