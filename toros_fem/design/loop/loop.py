"""The design loop: MMA on densities and pressure, with more cautious steps where one fails."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np

from toros_fem.base.archive import Archive
from toros_fem.base.array_types import Floats
from toros_fem.base.errors import CheckpointError, NoEquilibriumError, ParameterError
from toros_fem.base.mpi import collective, largest, norm
from toros_fem.base.rounding import rounded
from toros_fem.base.validation import require_callable, require_count, require_kind, shown
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.journal import (
    KIND,
    Journal,
    JournalEntry,
    restored_evaluation,
    restored_rows,
    saved_evaluation,
    saved_rows,
    signature_of,
)
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.design.loop.variables import Scaled, Values, Variables
from toros_fem.design.loop.warm_start import InitialDensity, WarmStart
from toros_fem.design.mma.optimizer import MMA, Functions, MMAState

# Number of steps over which T must fall.
LOOK_BACK = 10
# Least price of a violated constraint in the merit function, in MMA's scaled units.
PRICE = 1.0
# Part of its range to which a variable is rounded after each step, or KNOWN times `x_tol` if that
# is smaller. So runs that differ by rounding take the same steps: unrounded, the difference grows
# by a factor of up to ten in each.
RESOLUTION, KNOWN = 1e-3, 10.0
# What MMA carries from step to step: vectors of the variables, and small arrays.
MMA_VECTORS = ("previous", "before_previous", "distance")
MMA_SMALL = ("multipliers", "curvature")


@dataclass(frozen=True, eq=False)
class DesignResult:
    """The result of the design loop.

    Attributes:
        problem: The problem that was solved.
        density: Final ρ at owned triangles.
        final: Evaluation of the final design, with its gradients.
        history: One row for the start of each stage and one for each step; the last row is the
            final design.
        reason: Why the loop ended, as a sentence.
        seconds: Wall time by phase.
        initial: The density that the design began with; None where it began with none.
    """

    problem: DesignProblem
    density: Floats
    final: Evaluation
    history: tuple[Iteration, ...]
    reason: str
    seconds: dict[str, float]
    initial: InitialDensity | None = None

    @property
    def pressure(self) -> float:
        """Final pressure in Pa, the largest of all chambers."""
        return self.final.equilibrium.pressure

    @property
    def pressures(self) -> tuple[float, ...]:
        """Final pressure of each chamber in Pa."""
        return self.final.equilibrium.pressures


Callback = Callable[[Iteration, Evaluation], None]


@runtime_checkable
class ResumableCallback(Protocol):
    """A callback that also wants the rows of a loop that is resumed."""

    def restored(self, rows: Sequence[Iteration]) -> None:
        """Take the rows for which it was called before, on every rank."""


@collective("problem.comm", owned=("start", "after", "journal"))
def optimize(
    problem: DesignProblem,
    options: DesignOptions | Sequence[Stage] | None = None,
    *,
    start: Floats | None = None,
    seed: int = 0,
    callback: Callback | None = None,
    after: DesignResult | WarmStart | None = None,
    journal: Journal | None = None,
) -> DesignResult:
    """Minimise T over densities and pressure by MMA, stage by stage (collective).

    Args:
        problem: The design problem. It is not changed; the stages work on copies.
        options: Stages and stop rules, or the stages alone; None takes the defaults.
        start: ρ to start from at owned triangles, in [0, 1]; None takes that of `after`, or the
            problem's own start with random noise.
        seed: Seed of that noise. The same seed gives the same start on any number of ranks.
        callback: Called after each iteration, on every rank.
        after: A result to continue, or a start that was carried over from another mesh: pressure,
            shape and history are taken over.
        journal: Keeps the state of the loop; if it holds that of an earlier run, the loop goes on
            from there. None keeps nothing.

    Raises:
        CheckpointError: The state in the journal cannot be read, or belongs to something else.
        RunStoppedError: A signal asked for an end; the state is written.
        DensityError: The start does not fit or leaves [0, 1].
        ParameterError: A stage is constrained and the problem has no constraints.
        NoEquilibriumError: There is no equilibrium for the start. The loop steps back from later
            failures.
    """
    require_kind("problem", problem, DesignProblem, "a design problem, a ShapeDesign for instance")
    require_count(0, seed=seed)
    if callback is not None:
        require_callable("callback", callback, "a function of an iteration and an evaluation")
    if options is None:
        options = DesignOptions()
    elif isinstance(options, Stage):
        raise ParameterError("options is one Stage; give a list of stages, [Stage(…)].")
    elif not isinstance(options, DesignOptions):
        if not isinstance(options, list | tuple):
            raise ParameterError(
                f"options = {shown(options)} must be DesignOptions, or a list of Stages."
            )
        options = DesignOptions(tuple(options))
    if problem.length_scale is None and any(stage.constrained for stage in options.stages):
        raise ParameterError(
            "a stage has constrained = True, but the problem has no length_scale. Give the problem "
            "a LengthScale, or leave the stage unconstrained."
        )
    if start is None:
        start = problem.start_density(seed) if after is None else after.density
    start = problem.check_variables(start)
    initial = problem.initial_density(start) if after is None else after.initial
    entry = None
    if journal is not None:
        entry = journal.entry(problem.comm, signature_of(problem, options))
    loop = _Loop(problem, start, options, callback, entry)
    if after is not None:
        loop.take_over(after, start)
    first = loop.history[-1].stage + 1 if loop.history else 0
    try:
        saved = None if entry is None else entry.saved()
        begin = first if saved is None else loop.restore(saved)
        for number, stage in enumerate(options.stages, first):
            if number < begin:
                continue
            last = number - first == len(options.stages) - 1
            loop.run(number, stage, last=last, saved=saved if number == begin else None)
            if loop.over:
                break
    finally:
        if entry is not None:
            entry.close()
    assert loop.evaluation is not None
    return DesignResult(
        problem=problem,
        density=loop.evaluation.density,
        final=loop.evaluation,
        history=tuple(loop.history),
        reason=loop.reason,
        seconds=loop.phases,
        initial=initial,
    )


class _Loop:
    """The state of the design loop."""

    def __init__(
        self,
        problem: DesignProblem,
        density: Floats,
        options: DesignOptions,
        callback: Callback | None,
        entry: JournalEntry | None,
    ) -> None:
        self.problem, self.options, self.callback = problem, options, callback
        self.entry = entry
        self.comm = problem.skin.comm
        self.variables = Variables(problem, options)
        self.x = self.variables.vector(problem.with_passive(density), problem.pressures)
        self.evaluation: Evaluation | None = None
        self.state: Any = None  # to start from, as long as there is no evaluation
        self.level = 0
        self.history: list[Iteration] = []
        self.phases = {"filter": 0.0, "equilibrium": 0.0, "adjoint": 0.0, "mma": 0.0}
        self.steps = self.factorisations = self.rejected = 0
        self.change, self.steps_done = 0.0, 0
        self.begin = self.iteration_begin = time.perf_counter()
        self.over, self.reason = False, ""

    def take_over(self, earlier: DesignResult | WarmStart, density: Floats) -> None:
        """Take over pressure, shape and history of an earlier result, or of another mesh."""
        if isinstance(earlier, DesignResult):
            self.evaluation, self.level = earlier.final, earlier.history[-1].level
        else:
            self.state, self.level = earlier.state, earlier.level
        self.history = list(earlier.history)
        self.steps_done = self.history[-1].iteration if self.history else 0
        self.phases.update(earlier.seconds)
        if earlier.pressures:
            density = self.problem.with_passive(density)
            self.x = self.variables.vector(density, earlier.pressures)

    def restore(self, saved: Archive) -> int:
        """Take up a saved state, but for what `run` takes of it; return its stage."""
        numbers = saved.numbers
        try:
            self.x = self.variables.scatter(saved.arrays["x"])
            before, self.history = len(self.history), restored_rows(numbers["history"])
            self.level, self.steps_done = int(numbers["level"]), int(numbers["steps_done"])
            self.change = float(numbers["change"])
            self.phases = dict(numbers["phases"])
            self.begin = time.perf_counter() - float(numbers["seconds"])
            stage = int(numbers["stage"])
        except (KeyError, IndexError, TypeError, ValueError) as fault:
            raise CheckpointError(f"a checkpoint does not fit its loop: {fault}") from None
        if isinstance(self.callback, ResumableCallback):
            self.callback.restored(self.history[before:])
        self.iteration_begin = time.perf_counter()
        return stage

    def restore_stage(self, saved: Archive, mma: MMA, scaled: Scaled) -> tuple[int, float]:
        """Take up a saved state of MMA and its scale; return the step of the stage and its KKT."""
        numbers, arrays, own = saved.numbers, saved.arrays, self.variables.scatter
        try:
            vectors = {
                name: own(arrays[f"mma_{name}"]) if f"mma_{name}" in arrays else None
                for name in MMA_VECTORS
            }
            small = {
                name: None if numbers["mma"][name] is None else np.array(numbers["mma"][name])
                for name in MMA_SMALL
            }
            mma.state = MMAState(**vectors, **small, unit=float(numbers["mma"]["unit"]))
            scaled.scale = float(numbers["scale"])
            return int(numbers["count"]), float(numbers["kkt"])
        except (KeyError, IndexError, TypeError, ValueError) as fault:
            raise CheckpointError(f"a checkpoint does not fit its loop: {fault}") from None

    def checkpoint(
        self, number: int, count: int, kkt: float, mma: MMA, scaled: Scaled, of: Evaluation
    ) -> Archive:
        """Return the state after a row of the history (collective)."""
        arrays, numbers = saved_evaluation(self.problem, of)
        every, state = self.variables.gather, mma.state
        arrays["x"] = every(self.x)
        for name in MMA_VECTORS:
            vector = getattr(state, name)
            if vector is not None:
                arrays[f"mma_{name}"] = every(vector)
        small = {name: getattr(state, name) for name in MMA_SMALL}
        numbers["mma"] = {
            **{name: None if v is None else v.tolist() for name, v in small.items()},
            "unit": state.unit,
        }
        numbers |= {
            "stage": number,
            "count": count,
            "kkt": kkt,
            "scale": scaled.scale,
            "level": self.level,
            "steps_done": self.steps_done,
            "change": self.change,
            "phases": self.phases,
            "seconds": time.perf_counter() - self.begin,
            "history": saved_rows(self.history),
        }
        return Archive(KIND, arrays, numbers)

    def run(self, number: int, stage: Stage, *, last: bool, saved: Archive | None = None) -> None:
        """Run one stage from the current design, or from a saved state of this stage."""
        given, options = self.problem, self.options
        resolution = min(RESOLUTION, KNOWN * options.x_tol)
        if saved is None:
            # A start from another mesh or print has rounding of its own.
            self.x = rounded(self.x, resolution)
        projection, constrained = given.projection, stage.constrained
        if stage.beta is not None:
            projection = Projection(stage.beta, projection.eta)
        problem = given.with_projection(projection)
        self.problem = problem = problem if stage.robust else problem.without_variants()
        start = self.state if self.evaluation is None else self.evaluation.equilibrium
        try:
            evaluation = (
                self.simulate(start) if saved is None else restored_evaluation(problem, saved)
            )
        except NoEquilibriumError:
            if self.evaluation is None:
                raise
            self.over, self.reason = True, f"Stage {number} has no equilibrium to start from."
            self.problem = given
            return
        evaluation = self.differentiate(evaluation)
        assert evaluation.residuals is not None
        mma = MMA(
            self.comm,
            *self.variables.bounds,
            constraints=2 if constrained else 0,
            options=options.mma,
            move=self.variables.move,
            residuals=len(evaluation.residuals.gradients),
            resolution=resolution,
        )
        scaled = Scaled(
            problem,
            self.variables,
            constrained=constrained,
            target_objective=options.target_objective or 0.0,
            start=evaluation,
        )
        first, kkt = 0, math.inf
        if saved is not None:
            first, kkt = self.restore_stage(saved, mma, scaled)
        for count in range(first, stage.iterations + 1):
            known = saved is not None and count == first  # its row is in the history
            begin = time.perf_counter()
            factor = scaled.refer(evaluation)
            if not known:
                mma.rescale(factor)
            here, slopes = scaled.values(evaluation), scaled.gradients(evaluation)
            if count > 0 and not known:
                whole = Functions(
                    here.objective, slopes.objective, here.constraints, slopes.constraints
                )
                kkt = mma.kkt_residual(self.x, whole)
            self.phases["mma"] += time.perf_counter() - begin
            if not known:
                self.steps_done += count > 0
                self.record(number, evaluation, kkt)
                self.steps = self.factorisations = self.rejected = 0
            ended = self.finished(stage, count, kkt, last=last)
            if self.entry is not None and not known:
                state = partial(self.checkpoint, number, count, kkt, mma, scaled, evaluation)
                self.entry.offer(state, last=ended)
            if ended:
                break
            begin = time.perf_counter()
            before = self.x
            functions = Functions(
                here.rest,
                slopes.rest,
                here.constraints,
                slopes.constraints,
                here.residuals,
                slopes.residuals,
            )
            self.x = mma.step(before, functions)
            self.phases["mma"] += time.perf_counter() - begin
            trial = self.descend(mma, scaled, evaluation, here)
            if trial is None:
                self.x = before
                self.over = True
                self.reason = "The last step has no equilibrium; this is the last design with one."
                break
            self.change = largest(self.comm, np.max(np.abs(self.x - before), initial=0.0))
            evaluation = self.differentiate(trial)
        self.problem = given

    def differentiate(self, simulated: Evaluation) -> Evaluation:
        """Add the gradients of the current design."""
        begin = time.perf_counter()
        self.evaluation = self.problem.differentiate(simulated)
        self.phases["adjoint"] += time.perf_counter() - begin
        return self.evaluation

    def descend(
        self, mma: MMA, scaled: Scaled, near: Evaluation, here: Values
    ) -> Evaluation | None:
        """Return the design that MMA proposes, or a more cautious one; None without equilibrium."""
        o = self.options
        multipliers = np.asarray(mma.state.multipliers)[: len(here.constraints)]
        prices = np.maximum(PRICE, 2 * multipliers)

        def merit(values: Values) -> float:
            return values.objective + float(prices @ np.maximum(values.constraints, 0.0))

        bound = merit(here)

        def judge(trial: Evaluation | None) -> tuple[Values, bool]:
            there = here.missing if trial is None else scaled.values(trial)
            if trial is None:
                return there, False
            if o.descent == "conservative":
                return there, mma.conservative(self.x, there.functions)
            return there, merit(there) <= bound

        while True:
            enough, last = self.rejected >= o.retries, self.rejected >= 2 * o.retries
            trial = self.attempt(near, trial=not last)
            there, good = judge(trial)
            if trial is not None and (good or enough):
                trial = self.completed(trial)
                there, good = judge(trial)
            if trial is not None and (good or enough):
                return trial
            if last:
                return None
            self.rejected += 1
            self.x = mma.retry(self.x, there.functions)

    def finished(self, stage: Stage, count: int, kkt: float, *, last: bool) -> bool:
        """Return whether the stage ends here, and mark the end of the loop; equal on all ranks."""
        o, now = self.options, self.history[-1]
        if o.seconds is not None:
            spent = largest(self.problem.comm, time.perf_counter() - self.begin)
            if spent > o.seconds:
                self.over, self.reason = True, f"{o.seconds:g} s have passed."
                return True
        if count > 0 and kkt < o.kkt_tol:
            self.reason = f"The KKT residual is under {o.kkt_tol:g}."
        elif count > 0 and self.change < o.x_tol:
            self.reason = f"No variable changes by more than {o.x_tol:g} any more."
        elif self.target_met(stage, now):
            self.reason = f"T is at most {o.target_objective:g}."
        elif count >= LOOK_BACK and self.slow(stage):
            self.reason = (
                f"T fell by less than {o.min_relative_decrease:g} of it in {LOOK_BACK} steps."
            )
        elif count == stage.iterations:
            self.reason = f"All {o.iterations} iterations are done."
        else:
            return False
        self.over = last
        return True

    def target_met(self, stage: Stage, row: Iteration) -> bool:
        """Return whether T needs no further decrease."""
        target = self.options.target_objective
        return target is not None and row.objective <= target and self.kept(stage, row)

    def kept(self, stage: Stage, row: Iteration) -> bool:
        """Return whether the constraints of the stage hold."""
        if not stage.constrained:
            return True
        limits = self.problem.length_scale
        assert limits is not None
        return bool(row.g_r <= limits.epsilon[0] and row.g_t <= limits.epsilon[1])

    def slow(self, stage: Stage) -> bool:
        """Return whether T fell too little, while the constraints held."""
        before, now = self.history[-1 - LOOK_BACK], self.history[-1]
        kept = self.kept(stage, before) and self.kept(stage, now)
        fraction = self.options.min_relative_decrease
        if fraction is None or not kept:
            return False
        return now.objective > before.objective - fraction * abs(before.objective)

    def record(self, number: int, evaluation: Evaluation, kkt: float) -> None:
        e = evaluation
        assert e.gradient is not None
        volume_fraction, grey_level = self.problem.reinforcement(e)
        g_r, g_t = (0.0, 0.0) if e.length_scale is None else map(float, e.length_scale)
        row = Iteration(
            iteration=self.steps_done,
            stage=number,
            level=self.level,
            objective=e.objective,
            shape=e.shape,
            perimeter=e.perimeter or 0.0,
            g_r=g_r,
            g_t=g_t,
            pressure=e.equilibrium.pressure,
            gradient_norm=norm(self.comm, e.gradient),
            kkt=kkt,
            volume_fraction=volume_fraction,
            grey_level=grey_level,
            change=self.change,
            beta=self.problem.projection.beta,
            rejected=self.rejected,
            newton_steps=self.steps,
            factorisations=self.factorisations,
            seconds=time.perf_counter() - self.iteration_begin,
            metrics=self.problem.metrics_of(e.equilibrium),
        )
        self.iteration_begin = time.perf_counter()
        self.history.append(row)
        if self.callback is not None:
            self.callback(row, e)

    def simulate(self, start: Any, *, trial: bool = False) -> Evaluation:
        """Simulate the design that the variables stand for (collective)."""
        density, pressures = self.variables.design(self.x)
        return self.counted(lambda: self.problem.simulate(density, start, pressures, trial=trial))

    def attempt(self, near: Evaluation, *, trial: bool) -> Evaluation | None:
        """Simulate a design near another; None if it has no near equilibrium."""
        try:
            return self.simulate(near.equilibrium, trial=trial)
        except NoEquilibriumError:  # raised by all ranks or by none
            return None

    def completed(self, trial: Evaluation) -> Evaluation | None:
        """Complete a trial; None if there is no stable equilibrium near."""
        try:
            return self.counted(lambda: self.problem.finish(trial), of=trial)
        except NoEquilibriumError:  # raised by all ranks or by none
            return None

    def counted(self, action: Callable[[], Evaluation], of: Evaluation | None = None) -> Evaluation:
        """Run a simulation and add up its cost, also where it fails."""
        begin = time.perf_counter()
        try:
            found = action()
        except NoEquilibriumError as error:
            self.steps += error.steps
            self.factorisations += error.factorisations
            self.phases["equilibrium"] += time.perf_counter() - begin
            raise
        if found is not of:
            self.steps += found.steps
            self.factorisations += found.factorisations
            for phase, seconds in found.seconds.items():
                self.phases[phase] += seconds
        return found
