"""Design from a random start without drawn lines: relaxed design, printable lines, correction."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError, TorosError
from toros_fem.base.mpi import free_dropped, on_first_rank
from toros_fem.base.validation import Bools, Floats
from toros_fem.design.lines.field import LineField
from toros_fem.design.lines.laid_lines import LaidLines, changed
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.fields import CarriedDesign
from toros_fem.design.loop.levels import correct
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.miss import residuals_of, shape_of
from toros_fem.design.relaxed.find import RelaxedResult, find_lines
from toros_fem.making.as_printed import Shape
from toros_fem.measures.figures import TOLERANCE
from toros_fem.measures.metrics import Metric
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.actuators.corrections import (
    CLOSE,
    FINE,
    HELPS,
    StrainResponse,
    asked_next,
    strains_beyond,
    strains_to_ask,
    with_strains,
)
from toros_fem.products.actuators.estimates import Job, SimulatedPrint, values_on
from toros_fem.products.actuators.printed_lines import LinePrint, Mending, mending, print_of_lines
from toros_fem.results.reporter import print_line

log = logging.getLogger(__name__)

# Below these errors of metrics and of the shape the number of lines stays when they are laid anew.
NEAR, NEAR_SHAPE = 0.3, 2 * TOLERANCE
# Far from the targets a change of lines must promise to leave no more than this part of the
# residuals.
ENOUGH = 0.5
# A search ends after so many rounds in a row of which none helps.
PATIENCE = 2
# Miss of a shape below which a search ends; the error of the mesh is of this size.
CLOSE_SHAPE = TOLERANCE / 2


@dataclass(frozen=True, eq=False)
class Round:
    """One relaxed design, laid as lines and simulated.

    The print itself is not kept: its problem and factors are large.

    Attributes:
        asked: Target of each metric that was asked of the relaxed design, by key.
        relaxed: The relaxed design.
        laid: Its lines.
        metrics: Metrics of their print, by key; empty without an equilibrium.
        of_metrics, of_shape: Largest miss of a metric, and that of the shape, as of `Residuals`;
            infinite without an equilibrium.
        missed: Size of all residuals, as of `Residuals`.
        failure: Why the print has no equilibrium; empty if it has one.
        answer: What was asked of the shape, and what its print has; None where metrics are asked,
            or without an equilibrium.
        mended: The change of earlier lines that made these; None if they were laid.
        compared: Whether what a finer mesh has told beyond the print's mesh is in all this.
    """

    asked: Mapping[str, float]
    relaxed: RelaxedResult
    laid: LaidLines
    metrics: Mapping[str, float]
    of_metrics: float
    of_shape: float
    missed: float
    failure: str
    answer: StrainResponse | None
    mended: Mending | None
    compared: bool = False

    @property
    def error(self) -> float:
        """The larger one of both residuals."""
        return max(self.of_metrics, self.of_shape)


@dataclass(frozen=True, eq=False)
class Discovery:
    """Lines that were found from a random start.

    Attributes:
        rounds: All rounds, in the order in which they were made. Those since a finer mesh was asked
            have what it told beyond the print's mesh.
        best: The round whose print is closest to the targets, judged by the finer mesh if there is
            one.
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
        first, best = self.rounds[0].relaxed, self.best
        return {
            "relaxed": {
                **first.history[-1].metrics,
                "objective": first.history[-1].objective,
                "steps": len(first.history),
                "newton_steps": sum(row.newton_steps for row in first.history),
                "triangles": len(first.pattern.panel),
                "seconds": sum(first.seconds.values()),
            },
            "lines": {
                **best.metrics,
                "rounds": [
                    {"asked": dict(r.asked), "mended": r.mended is not None, **r.metrics}
                    for r in self.rounds
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

    The relaxed design is laid as lines, which are simulated as printed. Then lines are moved and
    change their widths, by what the print misses (`mending`). Where this does not promise enough,
    the next relaxed design is asked for another shape (space mapping, Bandler et al. 1994). Where
    places of cross-sections do not all count, metrics are asked for, if they are in fields of the
    scene (`targets`). Once a print is near the targets, it is simulated on a finer mesh too
    (`check_refinement`), and later prints are judged with what this mesh has told beyond the other.
    In the end it judges the best print; where only it tells that a tolerance is missed, the search
    goes on.

    Raises:
        NoEquilibriumError: No print has an equilibrium, or the random start has none.
        TorosError: A number is out of its bounds.
    """
    search = _Search(job)
    most = job.scene.design.corrections
    rounds = correct(search.first(), search.again, search.enough, most)
    if not np.isfinite(search.best[0].error):
        raise NoEquilibriumError(
            "no print of the relaxed design has an equilibrium: "
            f"{rounds[0].failure} Ask for less, or for finer lines (laid_width)."
        )
    while search.misled() and len(rounds) <= most:
        left = most + 1 - len(rounds)
        rounds += correct(search.best[0], search.again, search.enough, left)[1:]
    return Discovery(tuple(rounds), *search.told, dict(search.seconds))


class _Search:
    """Makes the rounds of a search; all methods are collective.

    Attributes:
        plain: The case on the mesh of the fabric.
        residuals: Those of its shapes.
        best: The best round and its print. Only this print and the judged one keep their problems.
        finer: The finer mesh, and its edge length over that of the prints; None without one.
        judged: The best round that it judged, and its print.
        asked: The round that it was last asked about.
        beyond: That minus what the print's own mesh tells, of the last print with both, at the
            vertices of its mesh, (n, 3), in m.
        number: Of the next round.
        seconds: As of `Discovery`.
    """

    def __init__(self, job: Job) -> None:
        self.job = job
        self.plain = job.scene.case(job.comm, job.scene.print_level)
        if self.plain.poses:
            raise ParameterError(
                "start = 'relaxed' lays lines for one pose, and the case has further ones. Set "
                "start = 'random'.",
                "start",
            )
        self.residuals = residuals_of(self.plain)
        self.best: tuple[Round, LinePrint]  # from the first print on
        self.finer = job.scene.checked(job.scene.print_level)
        self.judged: tuple[Round, LinePrint] | None = None
        self.asked: Round | None = None
        self.beyond: tuple[Pattern, Floats] | None = None
        self.number = 0
        self.seconds = {"relaxed": 0.0, "lines": 0.0, "prints": 0.0}

    def first(self) -> Round:
        """Return the first round: the scene's own target, which may be in none of its fields.

        Raises:
            NoEquilibriumError: The random start has no equilibrium.
        """
        scene = self.job.scene
        case = scene.case(self.job.comm, scene.relaxed_level)
        strains = None
        if self.residuals.labels is not None and self.residuals.compared.all():
            strains = np.zeros_like(residuals_of(case).rod(case.goal).strains)
        asked = {key: aim.target for key, aim in self.residuals.aims.items()}
        return self._asked(case, asked, strains, None, None)

    def again(self, rounds: Sequence[Round]) -> Round | None:
        """Return a round of changed lines, or of others that are asked for; None if it cannot.

        A change after which the print is no better is halved once.
        """
        last, best = rounds[-1], self.best[0]
        failed = last.mended is not None and last is not best
        if failed and last.mended is not None and last.mended.whole:
            return self._mended(best, last.mended.halved)
        found = None if failed else self._mending(best)
        laid = any(one.mended is None for one in rounds)  # what may be asked for again
        far = best.error > FINE and laid
        if found is None or (far and found.promised > ENOUGH * found.before):
            return self._asked_again(rounds)
        return self._mended(best, found)

    def enough(self, rounds: Sequence[Round]) -> bool:
        """Return whether the search ends with these rounds.

        It goes on while one of two rounds in a row helps: one changes lines, one asks for others.
        """
        last, like = rounds[-1], [one.error for one in _like_last(rounds)]
        before, now = like[:-PATIENCE], like[-PATIENCE:]
        return (
            (last.of_metrics < CLOSE and last.of_shape < CLOSE_SHAPE)
            or (bool(last.failure) and last.mended is None)
            or (bool(before) and min(now) > HELPS * min(before))
        )

    def _asked_again(self, rounds: Sequence[Round]) -> Round | None:
        """Return a round that asks for what the prints of laid lines have missed."""
        laid = [one for one in _like_last(rounds) if one.mended is None]
        # Where only a change of lines was compared, lines are asked for as without the finer mesh.
        laid = laid or [one for one in rounds if one.mended is None]
        if not laid:
            return None
        near = [
            k for k, one in enumerate(laid) if one.of_metrics < NEAR and one.of_shape < NEAR_SHAPE
        ]
        # Once lines are near, all later ones are like them: only these tell what one more asks for.
        begin, like = (near[0], laid[near[0]].laid) if near else (0, None)
        scene, comm = self.job.scene, self.job.comm
        answers = [one.answer for one in laid[begin:] if one.answer is not None]
        if answers:
            residuals = residuals_of(scene.case(comm, scene.relaxed_level))
            strains = strains_to_ask(residuals.rod(residuals.case.goal), answers)
            case = with_strains(residuals, strains)
            asked = {
                m.key: m.value(case.pattern, case.goal)
                for m in case.judged
                if m.key in self.residuals.aims
            }
        elif set(self.residuals.aims) <= set(scene.targets()):
            got, before = [one.metrics for one in laid[begin:]], [one.asked for one in laid[begin:]]
            strains, asked = None, asked_next(got, before, self.residuals.aims)
            try:
                case = scene.asked(asked).case(comm, scene.relaxed_level)
            except ParameterError:  # beyond what the targets' fields allow
                return None
        else:
            return None
        try:
            return self._asked(case, asked, strains, laid[-1].relaxed, like)
        except NoEquilibriumError:  # of the relaxed skin
            return None

    def _asked(
        self,
        case: Case,
        asked: Mapping[str, float],
        strains: Floats | None,
        after: RelaxedResult | None,
        like: LaidLines | None,
    ) -> Round:
        """Return the round of a relaxed design of a case that asks for a shape."""
        job, scene = self.job, self.job.scene
        with self._timed("relaxed"):
            relaxed = find_lines(
                job.problem(case, scene.relaxed_level),
                scene.relaxed_options,
                seed=scene.design.seed,
                callback=job.reporter,
                after=after,
                journal=job.journal,
            )
        given = case.prescribed
        printed = None if given is None else given > 0.5
        planes, options = tuple(case.symmetry), scene.line_options
        if like is not None and not _widths_suffice(like, relaxed.field, printed):
            like = None
        with self._timed("lines"):
            laid = on_first_rank(
                job.comm,
                lambda: lay_lines(
                    relaxed.field, options, printed=printed, planes=planes, like=like
                ),
            )
        near = case.pattern, relaxed.positions
        return self._printed(dict(asked), relaxed, laid, near, strains=strains)

    def _mending(self, best: Round) -> Mending | None:
        """Return the change that mends the best print most."""
        made = self.best[1]
        with self._timed("lines"):
            return mending(made, best.laid, residuals_of(made.case))

    def _mended(self, best: Round, step: Mending) -> Round:
        """Return the round of changed lines."""
        near = self.best[1].shape
        with self._timed("lines"):
            laid = on_first_rank(self.job.comm, lambda: changed(step.lines, step.change))
        return self._printed(best.asked, best.relaxed, laid, near, mended=step)

    def _printed(
        self,
        asked: Mapping[str, float],
        relaxed: RelaxedResult,
        laid: LaidLines,
        near: Shape,
        *,
        strains: Floats | None = None,
        mended: Mending | None = None,
    ) -> Round:
        """Simulate the print of lines, report its round, and keep the print if it is the best."""
        free_dropped(self.job.comm)  # the problem of the last print, if that was not the best
        with self._timed("prints"):
            level, pressures = self.job.scene.print_level, relaxed.pressures or None
            made = print_of_lines(
                self.job, level, self.plain, laid, near, pressures, alike=mended is not None
            )
        if self.beyond is not None:
            made = made.compared_with(*self.beyond)
        found = Round(
            asked,
            relaxed,
            laid,
            **_judged(made, strains),
            failure=made.printed.failure,
            mended=mended,
            compared=self.beyond is not None,
        )
        how = "" if mended is None else ", mended"
        _report(self.job.comm, f"round {self.number}", made.problem.metrics, found, how)
        self.number += 1
        if self.number > 1 and not found.missed < self.best[0].missed:
            return found
        self.best = found, made
        return self._compared() if self.beyond is None and found.error < FINE else found

    def misled(self) -> bool:
        """Return whether only the finer mesh tells that the best print misses a tolerance."""
        before, after = self.best[0].error, self._compared()
        known = self.judged is not None and self.judged[0] is after
        return known and before < TOLERANCE <= after.error

    @property
    def told(self) -> tuple[Round, LinePrint]:
        """The best round and its print."""
        if self.judged is not None and not self.best[0].missed < self.judged[0].missed:
            return self.judged
        return self.best

    def _compared(self) -> Round:
        """Judge the best print by the finer mesh, once; return its round, as it is without one."""
        best, made = self.best
        job = self.job
        if self.finer is None or self.asked is best:
            return best
        self.asked = best
        free_dropped(job.comm)  # prints that are neither the best nor the judged one
        keys = [*made.metrics, *shape_of(made.printed.evaluation)]
        try:
            with self._timed("prints"):
                ratio, level = self.finer
                there = values_on(job, level, SimulatedPrint.of(made.printed), keys, ratio)
        except TorosError as caught:  # raised by all ranks or by none
            if job.comm.rank == 0:
                log.warning("the finer mesh does not judge the print: %s", caught)
            return best
        finally:
            free_dropped(job.comm)
        pattern = made.case.pattern
        self.beyond = pattern, there.at_vertices(pattern) - made.own_shape
        made = made.compared_with(*self.beyond)
        strains = None if best.answer is None else best.answer.asked
        self.asked = found = replace(best, **_judged(made, strains), compared=True)
        self.best = found, made
        if self.judged is None or found.missed < self.judged[0].missed:
            self.judged = found, made
        _report(job.comm, "on a finer mesh", made.problem.metrics, found)
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
    made, history, level = found.made, found.best.relaxed.history, job.scene.density_level
    case = job.scene.case(job.comm, level).following(job.comm, made.regions, printed=False)
    lines, problem = made.printed.evaluation, job.problem(case, level)
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


def _judged(made: LinePrint, strains: Floats | None) -> dict[str, Any]:
    """Return what a round tells of its print, of which strains were asked."""
    infinite = dict.fromkeys(("of_metrics", "of_shape", "missed"), np.inf)
    if made.printed.failure:
        return {"metrics": {}, "answer": None, **infinite}
    residuals, shape, answer = residuals_of(made.case), made.shape[1], None
    if strains is not None:
        beyond = strains_beyond(residuals.rod(shape), residuals.rod(made.case.goal))
        answer = StrainResponse(strains, beyond)
    return {
        "metrics": made.metrics,
        "answer": answer,
        "of_metrics": residuals.of_metrics(shape),
        "of_shape": residuals.of_shape(shape),
        "missed": float(np.linalg.norm(residuals(shape))),
    }


def _like_last(rounds: Sequence[Round]) -> list[Round]:
    """Return the rounds that can be compared with the last one: with a finer mesh, or without."""
    return [one for one in rounds if one.compared == rounds[-1].compared]


def _widths_suffice(like: LaidLines, field: LineField, printed: Bools | None) -> bool:
    """Return whether lines may keep their number and take up the shares of a field by widths."""
    areas = field.pattern.areas if printed is None else field.pattern.areas * ~printed
    now = areas @ field.shares / areas.sum()
    before = np.array([family.share for family in like.families])
    room = np.sqrt(like.options.spread)
    return bool(((now <= room * before) & (before <= room * now)).all())


def _report(
    comm: MPI.Comm, name: str, metrics: Sequence[Metric], made: Round, how: str = ""
) -> None:
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
    shape = "" if made.failure else f"; shape off by {100 * made.of_shape:.2g} %"
    print_line(f"{name}: {lines} lines{how}, as printed {found}{shape}")
