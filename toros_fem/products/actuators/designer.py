"""Design of an actuator from start to files: optimise, print, correct, estimate, write."""

from __future__ import annotations

import logging
import math
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from toros_fem.base.errors import NoEquilibriumError, PanelError, TorosError
from toros_fem.base.files import guarded, if_possible
from toros_fem.base.mpi import free_dropped, on_first_rank
from toros_fem.design.loop.fields import CarriedDesign
from toros_fem.design.loop.levels import BestStart, best_start, optimize_levels
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.miss import shape_of
from toros_fem.design.loop.options import LOST, DesignOptions, Stage, growth_of_miss
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign, ShapeProblem
from toros_fem.making.as_printed import PrintedDesign, as_printed, patterns_without_islands
from toros_fem.making.machine_files import FOLDER, write_manufacture
from toros_fem.making.printability import PRINT, print_on, printed_fractions, read_print_polygons
from toros_fem.measures.figures import State, largest_part, overall, verdict_of
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.meshes.files import PATTERN_FILE
from toros_fem.products.actuators.corrections import corrected
from toros_fem.products.actuators.cost import require_affordable_meshes
from toros_fem.products.actuators.discovery import Discovery, densities_from, discover
from toros_fem.products.actuators.estimates import (
    Job,
    MeshValues,
    MetricErrors,
    SimulatedPrint,
    metric_errors,
    simulated_on,
    values_at,
)
from toros_fem.products.actuators.pressure import (
    doubts_of_poses,
    trimmed,
    worst_of_print,
    write_curve,
)
from toros_fem.products.actuators.result import SearchRecord, SkinDesign
from toros_fem.products.common.plausibility import doubts, target_doubts, warn_of_doubts
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.result import write_summary
from toros_fem.results.runs.open_run import run_of
from toros_fem.results.writer import draw_pictures, write_design

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import Level

# A print whose worst figure is off by so many tolerances is not tried without its islands.
FAR = 10.0
# Designs again from another pattern without islands (collective).
Polish = Callable[[], DesignResult]
# How far another seed is from the one that was given.
ANOTHER_SEED = 1000
log = logging.getLogger(__name__)
# A print is trimmed again by what a finer mesh tells if a figure is off by more than this part of
# its tolerance, or of the second where the verdict is not certain.
AGAIN, AGAIN_IF_OPEN = 0.5, 0.25
# Where coarser meshes leave the verdict open, one with edges so many times shorter tells the
# figures, if it has at most so many triangles.
FINER, MOST = 2.0, 100_000


class Attempt(NamedTuple):
    """A design, its print, the number of its corrections, and its seed if that is another."""

    design: DesignResult
    printed: PrintedDesign
    rounds: int = 0
    seed: int | None = None


# What is compared: as it was designed, or with its errors.
A = TypeVar("A", Attempt, SkinDesign)


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
    ) -> Attempt:
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
        best = corrected(
            result,
            printed,
            self.scene.design.finer_options,
            print_again=print_again,
            rounds=self.scene.design.corrections,
            tolerances=self.scene.results.tolerances,
            callback=self.reporter,
            journal=self.branch(branch),
        )
        return Attempt(*best, rounds)


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


@dataclass(frozen=True, eq=False, kw_only=True)
class Designer(DensityDesigner):
    """The design of an actuator, from start to files; all methods are collective.

    Attributes:
        output: Folder for summary, history, pattern, fields and pictures.
        source: Folder of a finished design whose print the densities start from; None for none.
    """

    output: Path | str
    source: Path | str | None = None

    def design(self) -> SkinDesign:
        """Design, and write all results."""
        scene, comm = self.scene, self.comm
        case = require_affordable_meshes(comm, scene)
        of_target = [] if case is None else target_doubts(case)
        of_poses = [doubt for pose in scene.scenes_of_poses for doubt in doubts(pose)]
        warn_of_doubts(comm, list(dict.fromkeys([*doubts(scene), *of_poses, *of_target])))
        # A given print is the start, whatever the seed.
        most = 1 if self.source is not None else scene.design.seeds
        best = self._best_of(
            self._checked(self._from_seed(0)),
            [partial(self._from_other_seed, number) for number in range(1, most)],
            _badness,
            lambda best, _: overall(best.figures) in (None, State.REACHED),
        )
        return self._finished(best)

    def _best_of(
        self,
        best: A,
        others: Iterable[Callable[[A], A]],
        badness: Callable[[A], Any],
        ends: Callable[[A, A | None], bool],
    ) -> A:
        """Return the best of a first attempt and of others, and keep its recorded shapes.

        Each is told the best so far. One whose start has no equilibrium is left out. `ends` tells
        of the best and the last one, None at first, whether there are no more.
        """
        least, ended = badness(best), ends(best, None)
        place = begin = self.reporter.attempt
        for attempt in others:
            if ended:
                break
            number = self.reporter.begin()
            try:
                last = attempt(best)
            except NoEquilibriumError:  # of its start; raised by all ranks or by none
                continue
            if (value := badness(last)) < least:
                best, least, place = last, value, number
            ended = ends(best, last)
            del last
            free_dropped(self.comm)
        self.reporter.keep(place, best.design.history[-1].iteration, begin)
        return best

    def _from_other_seed(self, number: int, best: SkinDesign) -> SkinDesign:
        """Return the design from another seed, the number of those before it, with errors."""
        if self.comm.rank == 0:
            log.warning("another seed is tried: %s", verdict_of(best.figures))
        return self._checked(self._from_seed(number))

    def _from_seed(self, number: int) -> SkinDesign:
        """Return the design from a seed, the number of those before it, without errors."""
        if number:
            scene = self.scene.updated(seed=self.scene.design.seed + number)
            way = replace(self, scene=scene, journal=self.branch(f"seed-{number}"))
        else:
            way = self
        if self.source is not None:
            return way._from_print(Path(self.source))
        if self.scene.design.start == "relaxed":
            return way._from_lines()
        return way._from_densities()

    def _from_print(self, source: Path) -> SkinDesign:
        """Design densities on the finest mesh from a given print, and correct them."""
        comm, scene = self.comm, self.scene
        lines = scene.design.start == "relaxed"
        level = scene.density_level if lines else scene.finest_level
        stored, case = read_print_polygons(comm, source), scene.case_of_poses(comm, level)
        try:
            own = print_on(comm, case, stored.pattern, stored.regions, any_size=True)
        except PanelError as caught:
            raise PanelError(f"{source} is the design of another skin: {caught}") from None
        density = on_first_rank(comm, lambda: printed_fractions(case.pattern, own))
        begin = CarriedDesign(case.pattern, density)
        return self._densified(
            [level], [scene.print_options], SearchRecord(scene.design.seed, "print", 0), begin
        )

    def _from_densities(self) -> SkinDesign:
        """Design densities on each level, from coarse to fine, and correct the last ones."""
        scene, design = self.scene, self.scene.design
        levels, options, after = scene.levels, scene.options, None
        search = SearchRecord(design.seed, "random", 0)
        if design.starts > 1:
            best = self._best_start()
            search, after = SearchRecord(best.seed, "random", 0, best.objectives), best.design
            # With one mesh alone all ranks finish the best design on it.
            levels, options = levels[1:] or levels, options[1:] or (design.finer_options,)
        return self._densified(levels, options, search, after)

    def _densified(
        self,
        levels: Sequence[Level],
        options: Sequence[DesignOptions],
        search: SearchRecord,
        after: CarriedDesign | None,
    ) -> SkinDesign:
        """Design densities on meshes, perhaps after a design of another, and correct the last."""
        comm, scene = self.comm, self.scene

        def problems() -> Iterator[ShapeDesign]:
            for level in levels:
                yield self.problem(scene.case_of_poses(comm, level), level)

        with self.reporter:
            made, others = self.over_levels(problems(), options, after)
            lost = after is None and self.lost(*made)
            best = self._best_of(
                self.corrected(*made),
                self._polishes(others),
                self._miss,
                lambda best, _: self._miss(best) <= 1,
            )
            # A print that corrections bring home needs no other way.
            if lost and self._miss(best) > 1:
                best, search = self._tried_otherwise(problems, options, best, search)
        if self.source is None and problem_of(best.design).fields.centre is not None:
            search = replace(search, start="pattern")
        search = replace(search, rounds=best.rounds)
        return self._found(best.design, best.printed, search)

    def _miss(self, attempt: Attempt) -> float:
        return self.worst(attempt.printed)

    def _polishes(self, others: Sequence[Polish]) -> Iterator[Callable[[Attempt], Attempt]]:
        """Yield what polishes a design from other patterns without islands, and corrects it."""

        def polished(polish: Polish, branch: str, _: Attempt) -> Attempt:
            design = polish()
            return self.corrected(design, self.print_of(design), branch=branch)

        for number, polish in enumerate(others, 2):
            yield partial(polished, polish, f"correction-{number}")

    def _tried_otherwise(
        self,
        problems: Callable[[], Iterator[ShapeDesign]],
        options: Sequence[DesignOptions],
        lost: Attempt,
        search: SearchRecord,
    ) -> tuple[Attempt, SearchRecord]:
        """Design anew where printable lines lost the shape, until one does not; correct the best.

        With it comes how it was searched.
        """
        tried: list[str] = []

        def anew(name: str, rules: Sequence[DesignOptions], seed: int, _: Attempt) -> Attempt:
            if self.comm.rank == 0:
                log.warning("printable lines lost the shape: the design is tried with %s", name)
            way = replace(self, journal=self.branch(name.replace(" ", "-")))
            tried.append(name)
            made = way.over_levels(problems(), rules, seed=seed)[0]
            return Attempt(*made, seed=seed)

        ways = other_ways(options, self.scene.design.seed, self.scene.design.beta)
        best = self._best_of(
            lost,
            [partial(anew, *way) for way in ways],
            self._miss,
            lambda _, last: last is not None and not self.lost(last.design, last.printed),
        )
        search = replace(search, tried=tuple(tried))
        if best is lost:
            return lost, search
        search = replace(search, seed=search.seed if best.seed is None else best.seed)
        best = self.corrected(best.design, best.printed, branch="other-correction")
        return best._replace(rounds=lost.rounds + best.rounds), search

    def _from_lines(self) -> SkinDesign:
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
        search = SearchRecord(
            scene.design.seed,
            "relaxed",
            len(found.rounds) - 1,
            lines=found,
            densities_kept=better is not None,
        )
        if better is not None:
            return self._found(*better, search)
        printed = self.trimmed(found.made.printed)
        assert printed.evaluation is not None  # as the print before
        return self._found(replace(found.result(), final=printed.evaluation), printed, search)

    def _best_start(self) -> BestStart:
        """Return the best of several starts on the coarsest mesh, each rank trying its own."""
        scene, design, level = self.scene, self.scene.design, self.scene.levels[0]
        best = best_start(
            self.comm,
            lambda alone: scene.problem(alone, scene.case_of_poses(alone, level), level),
            scene.options[0],
            range(design.seed, design.seed + design.starts),
            self.journal,
        )
        for row in best.design.history:
            self.reporter.report(row)
        return best

    def _densities(self, found: Discovery) -> tuple[DesignResult, PrintedDesign] | None:
        """Design and correct densities from lines; None if the print is not better."""
        designed = densities_from(self, found)
        if designed is None:
            return None
        best = self.corrected(designed, self.print_of(designed))
        better = self._miss(best) < self.worst(self.trimmed(found.made.printed))
        return (best.design, best.printed) if better else None

    def _found(
        self, result: DesignResult, printed: PrintedDesign, search: SearchRecord
    ) -> SkinDesign:
        """Return a design and its print."""
        return SkinDesign(
            result,
            printed,
            printed.metrics,
            config=self.scene,
            shape=shape_of(printed.evaluation),
            tolerances=self.scene.results.tolerances,
            search=search,
            corrections=self.scene.design.corrections,
        )

    def _checked(self, found: SkinDesign) -> SkinDesign:
        """Write a design and its summary, and return it with errors.

        What took longest to find is on disk first.
        """
        found = self._write(found)
        write_summary(self.comm, self.output, found)
        if not self.scene.results.estimate_error:
            return found
        self._check()
        return self._told(found)

    def _finished(self, found: SkinDesign) -> SkinDesign:
        """Write a design with its curve, machine files, trial, pictures and last summary."""
        scene, folder, printed = self.scene, Path(self.output), found.printed
        self._check()
        curve = write_curve(self.comm, folder, printed, scene.results, scene.MEASURED)
        made = printed.evaluation
        unreached = () if made is None else doubts_of_poses(made)
        found = self._write(replace(found, curve=curve, pose_doubts=unreached))
        if curve is not None and curve.doubt is not None and self.comm.rank == 0:
            log.warning("%s: it may not take the shape that is told", curve.doubt)
        for doubt in unreached if self.comm.rank == 0 else ():
            log.warning("%s: it may not take the shape that is told", doubt)
        summary, place = found.summary(), folder / FOLDER

        def make() -> None:
            copies = PATTERN_FILE, PRINT  # so that the folder holds what can be simulated again
            write_manufacture(
                place, printed.pattern, printed.regions, summary=summary, others=copies
            )
            for name in copies:
                shutil.copyfile(folder / name, place / name)

        guarded(self.comm, folder, lambda: if_possible("machine files", make))
        other = None
        if scene.results.estimate_error and printed.evaluation is not None:
            other = partial(self._on_other_mesh, printed)
        trial = scene.trial(self.comm, folder, found, other)
        found = replace(found, trial=trial, seconds=dict(self.reporter.seconds))
        write_summary(self.comm, folder, found)
        draw_pictures(self.comm, folder, lambda: _draw_lines(folder, found))
        return found

    def _check(self) -> None:
        """Stop here if the run was asked to stop."""
        run = run_of(self.output)
        if run is not None:
            run.check()

    def _write(self, found: SkinDesign) -> SkinDesign:
        """Write a design and return it with the time that it took until now."""
        found = replace(found, seconds=dict(self.reporter.seconds))
        write_design(self.output, found)
        return found

    def _told(self, found: SkinDesign) -> SkinDesign:
        """Return a result with errors, and with the figures of a finer mesh if there is one.

        That mesh is asked for, or it is tried where its own meshes leave the verdict open, and for
        skins that are flat at rest: coarser meshes of these may agree with each other and be wrong.
        """
        made, level = found.printed.evaluation, self.scene.level_of_print
        if made is None:
            return found
        coarser = replace(self, scene=self.scene.updated(check_refinement=None))
        errors = coarser._errors(found)
        found, finer = found.with_errors(errors), self.scene.checked(level)
        if finer is None:
            problem = made.problem
            assert isinstance(problem, ShapeProblem)
            count = FINER**2 * len(problem.skin.pattern.panel)
            told = errors.failure is None and overall(found.figures) is not State.NOT_CERTAIN
            if count > MOST or (told and not problem.flat_at_rest):
                return found
            finer = self.scene.finer(level, FINER)
        self._check()
        ratio, level = finer
        try:
            there = simulated_on(self, level, SimulatedPrint.of(found.printed), ratio)
        except TorosError as caught:  # raised by all ranks or by none
            if self.comm.rank == 0:
                log.warning("the check on a finer mesh is left out: %s", caught)
            return found
        found = self._there(found, there, ratio, errors.found)
        for improved in (self._trimmed_there, self._corrected_there):
            enough = AGAIN_IF_OPEN if overall(found.figures) is State.NOT_CERTAIN else AGAIN
            if largest_part(found.figures) <= enough:
                break
            other = improved(found, there, finer)
            if other is not None and _badness(other[0]) < _badness(found):
                found, there = other
            del other
            free_dropped(self.comm)
        return found

    def _there(
        self,
        found: SkinDesign,
        there: Evaluation[Equilibrium],
        ratio: float,
        known: Mapping[float, MeshValues] | None = None,
    ) -> SkinDesign:
        """Return a result with errors, and with what a print tells on a finer mesh."""
        values = values_at(there, [*found.printed.metrics, *found.shape])
        return found.with_errors(self._errors(found, {**(known or {}), ratio: values}))

    def _trimmed_there(
        self, found: SkinDesign, there: Evaluation[Equilibrium], finer: tuple[float, Level]
    ) -> tuple[SkinDesign, Evaluation[Equilibrium]] | None:
        """Return a result at the pressure that suits its print best on a finer mesh.

        With it comes the print on that mesh. None if that is the pressure that it has.
        """
        if self.holds(found.printed):
            return None
        fine = replace(found.printed, evaluation=there)
        tolerances, designed = found.tolerances, self._designed_pressures(found)
        moved = trimmed(fine, tolerances=tolerances, designed=designed).evaluation
        if moved is None or moved is there:
            return None
        printed = _at_pressures(found.printed, moved.equilibrium.pressures)
        if printed.evaluation is None:
            return None
        other = self._found(found.design, printed, found.search)
        return self._there(other, moved, finer[0]), moved

    def _corrected_there(
        self, found: SkinDesign, there: Evaluation[Equilibrium], finer: tuple[float, Level]
    ) -> tuple[SkinDesign, Evaluation[Equilibrium]] | None:
        """Return a design that went on towards what its print misses on a finer mesh.

        With it comes its print on that mesh. None if that is no better. Designs of lines have fine
        prints, and corrections of their own.
        """
        if found.search.lines is not None:
            return None
        kept: list[tuple[PrintedDesign, PrintedDesign]] = []
        ratio, level = finer

        def print_again(result: DesignResult) -> PrintedDesign:
            own = self.print_of(result)
            if own.evaluation is None:
                return own
            try:
                other = simulated_on(self, level, SimulatedPrint.of(own), ratio)
            except TorosError as caught:  # raised by all ranks or by none
                return replace(own, evaluation=None, failure=str(caught))
            fine = self.trimmed(replace(own, evaluation=other))
            assert fine.evaluation is not None
            if fine.evaluation is not other:
                own = _at_pressures(own, fine.evaluation.equilibrium.pressures)
            kept.append((fine, own))
            return fine

        start = replace(found.printed, evaluation=there)
        result, fine, rounds, _ = self.corrected(
            found.design, start, print_again, "finer-correction"
        )
        own = next((own for made, own in kept if made is fine), None)
        if own is None or own.evaluation is None or fine.evaluation is None:
            return None
        search = replace(found.search, rounds=found.search.rounds + rounds)
        other = self._found(result, own, search)
        return self._there(other, fine.evaluation, ratio), fine.evaluation

    def _designed_pressures(self, found: SkinDesign) -> tuple[float, ...]:
        """Return the pressures of the design before its print was trimmed."""
        lines = found.search.lines
        if found.search.laid and lines is not None:
            made = lines.made.printed.evaluation
            assert made is not None
            return made.equilibrium.pressures
        return found.design.pressures

    def _errors(
        self, found: SkinDesign, known: Mapping[float, MeshValues] | None = None
    ) -> MetricErrors:
        """Return the errors of the metrics of a print that has an equilibrium."""
        made, simulated = found.printed.evaluation, SimulatedPrint.of(found.printed)
        assert made is not None
        whole, keys = made.problem.whole.pattern, [*made.metrics, *found.shape]
        own, level = values_at(made, keys), self.scene.level_of_print
        return metric_errors(self, level, own, simulated, whole, known)

    def _on_other_mesh(self, printed: PrintedDesign) -> Evaluation[Equilibrium]:
        """Return the simulated print on the mesh where its trial is repeated."""
        self._check()
        ratio = self.scene.TRIAL_MESH
        return simulated_on(
            self, self.scene.level_of_print.scaled(ratio), SimulatedPrint.of(printed), ratio
        )


def _badness(found: SkinDesign) -> tuple[bool, float]:
    """Return whether a print does not certainly reach its targets, and its worst figure."""
    return overall(found.figures) is not State.REACHED, largest_part(found.figures)


def _at_pressures(printed: PrintedDesign, pressures: Sequence[float]) -> PrintedDesign:
    """Return a print at other pressures, on its own mesh (collective)."""
    own = printed.evaluation
    assert own is not None
    try:
        made = own.problem.simulate_binary(own.projected, own, pressure=pressures)
    except NoEquilibriumError as caught:  # raised by all ranks or by none
        return replace(printed, evaluation=None, failure=str(caught))
    return replace(printed, evaluation=made)


def _draw_lines(folder: Path, found: SkinDesign) -> None:
    """Draw the line families that a design was made of, if it was (one rank)."""
    from toros_fem.results.pictures.flat import draw_lines
    from toros_fem.results.pictures.style import page

    lines, printed = found.search.lines, found.printed
    if lines is not None and lines.best.relaxed is not None:
        with page(folder / "lines.png") as figure:
            draw_lines(figure, lines.best.relaxed.field, printed.pattern, printed.regions)
