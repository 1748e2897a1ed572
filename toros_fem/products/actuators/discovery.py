"""Design from a random start without drawn lines: relaxed design, printable lines, correction."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.mpi import free_dropped, on_first_rank
from toros_fem.design.lines.laid_lines import LaidLines
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.design.loop.carried import CarriedDesign
from toros_fem.design.loop.corrections import correct
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.relaxed.find import RelaxedResult, find_lines
from toros_fem.measures.metrics import Metric
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.line_print import LinePrint, Shape, print_of_lines
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

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import ActuatorScene

# Below this error lines stay where they are, and corrections change their widths first.
NEAR = 0.3


@dataclass(frozen=True, eq=False)
class Round:
    """One relaxed design, laid as lines and simulated.

    The print itself is not kept: its problem and factors are large.

    Attributes:
        asked: Target of each metric that was asked of the relaxed design, by key.
        relaxed: The relaxed design.
        laid: Its lines.
        metrics: Metrics of their print, by key; empty without an equilibrium.
        error: Largest distance of a metric from its target, over its scale; infinite without an
            equilibrium.
        failure: Why the print has no equilibrium; empty if it has one.
        widened: Whether these are the lines of the round before, with other widths.
    """

    asked: Mapping[str, float]
    relaxed: RelaxedResult
    laid: LaidLines
    metrics: Mapping[str, float]
    error: float
    failure: str
    widened: bool


@dataclass(frozen=True, eq=False)
class Discovery:
    """Lines that were found from a random start.

    Attributes:
        rounds: All rounds, in the order in which they were made.
        best: The round whose print is closest to the targets.
        made: Its print.
        seconds: Wall time in s of the relaxed designs, of laying lines, and of simulating prints.
    """

    rounds: Sequence[Round]
    best: Round
    made: LinePrint
    seconds: Mapping[str, float]

    def result(self) -> DesignResult:
        """Return the best round as the result of a design; its history is the relaxed design's."""
        relaxed, evaluation = self.best.relaxed, self.made.printed.evaluation
        assert evaluation is not None
        return DesignResult(
            problem=self.made.problem,
            density=evaluation.projected,
            final=evaluation,
            history=relaxed.history,
            reason=relaxed.reason,
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
                        "lines": len(f.lines),
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


def discover(job: Job) -> Discovery:
    """Find printable lines that take an actuator to its target, from noise (collective).

    The relaxed design is laid as lines, which are simulated as printed. Where the print misses by
    far, the next relaxed design asks for more (space mapping, Bandler et al. 1994): it costs a
    fraction of a simulated print. The widths of the lines take away a small miss
    (`mended_widths`). Where a target is in no field of the scene (`targets`), there is one round.

    Raises:
        NoEquilibriumError: No print has an equilibrium, or the random start has none.
        TorosError: A number is out of its bounds.
    """
    search = _Search(job)
    rounds = correct(search.first(), search.again, search.enough, job.scene.design.corrections)
    assert search.best is not None
    best, made = search.best
    if not np.isfinite(best.error):
        raise NoEquilibriumError(
            "no print of the relaxed design has an equilibrium: "
            f"{rounds[0].failure} Ask for less, or for finer lines (laid_width)."
        )
    return Discovery(tuple(rounds), best, made, dict(search.seconds))


class _Search:
    """Makes the rounds of a search; all methods are collective.

    Attributes:
        plain: The case on the mesh that is moved onto lines.
        aims: Targets of its metrics, by key.
        best: The best round and its print. Only this print and the last one keep their problems.
        last: The last print.
        number: Of the next round.
        seconds: As of `Discovery`.
    """

    def __init__(self, job: Job) -> None:
        self.job = job
        self.plain = job.scene.case(job.comm, job.scene.print_level)
        self.aims = aims_of(self.plain.judged)
        self.best: tuple[Round, LinePrint] | None = None
        self.last: LinePrint | None = None
        self.number = 0
        self.seconds = {"relaxed": 0.0, "lines": 0.0, "prints": 0.0}

    def first(self) -> Round:
        """Return the first round: the scene's own targets, which may be in none of its fields.

        Raises:
            NoEquilibriumError: The random start has no equilibrium.
        """
        asked = {key: aim.target for key, aim in self.aims.items()}
        return self._asked(self.job.scene, asked, None, None)

    def again(self, rounds: Sequence[Round]) -> Round | None:
        """Return a round of wider lines, or of lines that are asked for more; None if it cannot."""
        last, near = rounds[-1], [k for k, one in enumerate(rounds) if one.error < NEAR]
        helped = not last.widened or last.error < HELPS * rounds[-2].error
        if last.error < NEAR and (helped or _best(rounds).error < FINE):
            wider = self._wider(last)
            if wider is not None:
                return wider
        # Once lines are near, all later ones are like them: only these tell what one more asks for.
        begin, like = (near[0], rounds[near[0]].laid) if near else (0, None)
        asked = asked_next([one for one in rounds[begin:] if not one.widened], self.aims)
        try:
            scene = self.job.scene.asked(asked)
        except ParameterError:  # beyond what the targets' fields allow
            return None
        try:
            return self._asked(scene, asked, last.relaxed, like)
        except NoEquilibriumError:  # of the relaxed skin
            return None

    def enough(self, rounds: Sequence[Round]) -> bool:
        """Return whether the search ends with these rounds."""
        last, best = rounds[-1], _best(rounds)
        return (
            last.error < CLOSE
            or not set(self.aims) <= set(self.job.scene.targets())
            or (bool(last.failure) and not last.widened)
            or (best.error < FINE and len(rounds) - rounds.index(best) > 2)
        )

    def _asked(
        self,
        scene: ActuatorScene,
        asked: Mapping[str, float],
        after: RelaxedResult | None,
        like: LaidLines | None,
    ) -> Round:
        """Return the round of a relaxed design of a scene with these targets."""
        job, level = self.job, scene.relaxed_level
        with self._timed("relaxed"):
            case = scene.case(job.comm, level)
            relaxed = find_lines(
                job.problem(case, level),
                scene.relaxed_options,
                seed=scene.design.seed,
                callback=job.reporter,
                after=after,
                journal=job.journal,
            )
        printed = None if case.passive is None else case.passive > 0.5
        planes, options = tuple(case.symmetry), scene.line_options
        with self._timed("lines"):
            laid = on_first_rank(
                job.comm,
                lambda: lay_lines(
                    relaxed.field, options, printed=printed, planes=planes, like=like
                ),
            )
        return self._print(asked, relaxed, laid, (case.pattern, relaxed.positions), widened=False)

    def _wider(self, last: Round) -> Round | None:
        """Return a round of the last lines with other widths; None where these cannot help."""
        made = self.last
        assert made is not None
        with self._timed("lines"):
            laid, near = mended_widths(made, last.laid, self.aims), made.shape
        del made  # or its problem would not be freed before the next one
        if laid is None:
            return None
        return self._print(last.asked, last.relaxed, laid, near, widened=True)

    def _print(
        self,
        asked: Mapping[str, float],
        relaxed: RelaxedResult,
        laid: LaidLines,
        near: Shape,
        *,
        widened: bool,
    ) -> Round:
        """Simulate the print of lines, and return the round."""
        self.last = None  # its problem is freed if it is not the best one's
        free_dropped(self.job.comm)
        with self._timed("prints"):
            level, pressures = self.job.scene.print_level, relaxed.pressures or None
            made = print_of_lines(self.job, level, self.plain, laid, near, pressures)
            metrics = made.metrics
            error = largest_error(metrics, self.aims)
            failure = made.printed.failure
            found = Round(dict(asked), relaxed, laid, metrics, error, failure, widened)
        self.last = made
        if self.best is None or error < self.best[0].error:
            self.best = found, made
        _report(self.job.comm, self.number, made.problem.metrics, found)
        self.number += 1
        return found

    @contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - begin


def densities_from(job: Job, found: Discovery) -> DesignResult | None:
    """Design the densities on from the best lines; None without an equilibrium (collective).

    Width constraints hold from the first step, and the filter radius is about the lines' width.
    """
    made, history = found.made, found.best.relaxed.history
    lines, problem = made.printed.evaluation, job.problem(made.case, job.scene.density_level)
    assert lines is not None
    carried = CarriedDesign(
        made.problem.skin.pattern,
        made.problem.skin.gather_cells(lines.projected),
        lines.equilibrium.pressures,
        made.shape[1],
        level=history[-1].level + 1,
        history=history,
    )
    options = job.scene.density_options
    try:
        return optimize(problem, options, callback=job.reporter, after=carried, journal=job.journal)
    except NoEquilibriumError:  # of the blurred lines; raised by all ranks or by none
        return None


def _best(rounds: Sequence[Round]) -> Round:
    return min(rounds, key=lambda one: one.error)


def _report(comm: MPI.Comm, number: int, metrics: Sequence[Metric], made: Round) -> None:
    """Print a line on a round, on the first rank."""
    if comm.rank:
        return
    parts = [
        f"{m.name} {m.formatted(made.metrics[m.key])} of {m.formatted(m.target)}"
        + f", asked {m.formatted(made.asked[m.key])}"
        for m in metrics
        if m.target is not None and made.metrics
    ]
    lines = sum(len(f.lines) for f in made.laid.families)
    found = "no equilibrium" if made.failure else "; ".join(parts)
    widths = " of other widths" if made.widened else ""
    print_line(f"round {number}: {lines} lines{widths}, as printed {found}")
