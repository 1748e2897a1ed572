"""The design loop: MMA on densities and pressure, with more cautious steps where one fails."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from toros_fem.base.errors import CheckpointError, NoEquilibriumError, ParameterError
from toros_fem.base.files import Archive
from toros_fem.base.mpi import largest, norm, on_first_rank, rounded, total
from toros_fem.base.validation import Floats, require_callable, require_count, require_kind
from toros_fem.design.loop.fields import CarriedDesign, InitialDensity, initial_density
from toros_fem.design.loop.journal import (
    KIND,
    Journal,
    JournalEntry,
    content_of,
    fitting,
    restored_evaluation,
    saved_evaluation,
    signature_of,
)
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage, reason_to_end
from toros_fem.design.loop.problem import DesignProblem, Evaluation, Slopes
from toros_fem.design.loop.steps import Steps, Variables, by_cell, resolution_of
from toros_fem.design.mma.optimizer import Functions

# Key of the wall time for meshes, problems and transfers of all levels but the first.
SETUP = "next levels"


@dataclass(frozen=True, eq=False, repr=False)
class DesignResult:
    """The result of the design loop.

    Attributes:
        problem: The problem that was solved.
        density: Final ρ at owned triangles.
        final: Evaluation of the final design.
        history: One row for the start of each stage and one for each step; the last row is the
            final design.
        reason: Why the loop ended, as a sentence.
        seconds: Wall time by phase.
        initial: As of `CarriedDesign`.
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
        """Final pressure in Pa, the largest of all chambers; 0 without any."""
        return max(self.pressures, default=0.0)

    @property
    def pressures(self) -> tuple[float, ...]:
        """Final pressure of each chamber in Pa."""
        return self.final.equilibrium.pressures

    def __repr__(self) -> str:
        last = self.history[-1]
        told = "".join(f"{key} {value:.4g}, " for key, value in last.metrics.items())
        steps = f"T {last.objective:.4g} after {last.iteration} steps"
        return f"DesignResult({told}{steps}: {self.reason})"


Callback = Callable[[Iteration, Evaluation], None]


def optimize(
    problem: DesignProblem,
    options: DesignOptions | Sequence[Stage] | None = None,
    *,
    start: Floats | None = None,
    seed: int = 0,
    callback: Callback | None = None,
    after: DesignResult | CarriedDesign | None = None,
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
        after: A result of this problem to continue, or a design of another mesh: pressures, shape
            and history are taken over.
        journal: Keeps the state of the loop; if it holds that of an earlier run, the loop goes on
            from there. None keeps nothing.

    Raises:
        CheckpointError: The state in the journal cannot be read, or belongs to something else.
        RunStoppedError: A signal asked for an end; the state is written.
        ParameterError: The start does not fit or leaves [0, 1]; or no triangle is designed. A stage
            is constrained and the problem has no constraints.
        NoEquilibriumError: There is no equilibrium for the start. The loop steps back from later
            failures.
    """
    require_kind("problem", problem, DesignProblem, "a design problem, a ShapeDesign for instance")
    if callback is not None:
        require_callable("callback", callback, "a function of an iteration and an evaluation")
    options, seed = on_first_rank(problem.comm, partial(_settings, options, seed))
    if total(problem.comm, problem.designed.sum()) == 0:
        raise ParameterError(
            "passive prescribes the density of every triangle: none is designed. Set NaN where the "
            "density is to be designed."
        )
    if problem.length_scale is None and any(stage.constrained for stage in options.stages):
        raise ParameterError(
            "a stage has constrained = True, but the problem has no length_scale. Give the problem "
            "a LengthScale, or leave the stage unconstrained."
        )
    stages = tuple(replace(stage, iterations=1) for stage in options.stages)  # may go further
    signature = signature_of(problem, replace(options, stages=stages), _content(after))
    entry = (journal or Journal()).entry(problem.comm, signature)
    try:
        saved = entry.saved()
        soft: tuple[int, ...] = ()
        if after is None and start is None and problem.poses and problem.on_one_path:
            options = options.with_first_pose()
        if after is None and start is None and problem.fields.beta > 0:
            # A run that goes on keeps the soft start that it has made.
            soft = options.soft_steps() if saved is None else tuple(saved.numbers["soft"])
        options = options.softened(problem.fields.beta, soft)
        run = _Run(problem, options, callback, entry, soft)
        run.begin_at(start, seed, after)
        first = run.next_stage
        begin = first if saved is None else run.restore(saved)
        for number, stage in enumerate(options.stages, first):
            if number >= begin:
                last = number - first == len(options.stages) - 1
                run.stage(number, stage, saved if number == begin else None, last=last)
            if run.over:
                break
    finally:
        entry.close()
    assert run.here is not None
    return DesignResult(
        problem=problem,
        density=run.here.density,
        final=run.here,
        history=tuple(run.history),
        reason=run.reason,
        seconds=run.phases,
        initial=run.initial,
    )


def _content(after: DesignResult | CarriedDesign | None) -> str:
    """Return a text that tells a design that a loop continues from others (collective)."""
    if after is None:
        return ""
    if isinstance(after, DesignResult):
        return content_of(by_cell(after.problem.skin, after.density))
    return content_of(after.density)


def _settings(
    options: DesignOptions | Sequence[Stage] | None, seed: int
) -> tuple[DesignOptions, int]:
    """Return options and seed as a loop takes them, checked."""
    require_count(0, seed=seed)
    if options is None:
        return DesignOptions(), seed
    if isinstance(options, DesignOptions):
        return options, seed
    require_kind("options", options, (list, tuple), "DesignOptions, or a list of Stages")
    return DesignOptions(tuple(options)), seed


class _Run:
    """The state of the design loop.

    Attributes:
        x: The design variables.
        here: The last accepted design; None before the first one.
        start: What the first simulation starts from.
    """

    def __init__(
        self,
        problem: DesignProblem,
        options: DesignOptions,
        callback: Callback | None,
        entry: JournalEntry,
        soft: Sequence[int],
    ) -> None:
        self.problem, self.options, self.callback = problem, options, callback
        self.entry, self.comm, self.soft = entry, problem.skin.comm, soft
        self.variables = Variables(problem, options)
        self.here: Evaluation | None = None
        self.start: Any = None
        self.initial: InitialDensity | None = None
        self.level = 0
        self.history: list[Iteration] = []
        self.phases = {"filter": 0.0, "equilibrium": 0.0, "adjoint": 0.0, "mma": 0.0}
        self.steps = self.factorisations = self.rejected = 0
        self.change, self.steps_done = 0.0, 0
        self.begin = self.iteration_begin = time.perf_counter()
        self.over, self.reason = False, ""

    @property
    def next_stage(self) -> int:
        """Number of the stage after those of the history."""
        return self.history[-1].stage + 1 if self.history else 0

    def begin_at(
        self, start: Floats | None, seed: int, after: DesignResult | CarriedDesign | None
    ) -> None:
        """Take variables, pressures, state and history to start from (collective)."""
        fields, pressures = self.problem.fields, self.problem.physics.pressures
        if isinstance(after, DesignResult):
            given, self.here, self.start = after.density, after.final, after.final.start
            self.level = after.history[-1].level
        elif after is not None:
            given, self.start = after.on(self.problem)
            self.level = after.level
        else:
            given = fields.start(seed) if start is None else start
        x = fields.checked(given if start is None else start)
        if after is None:
            self.initial = initial_density(self.problem, x)
        else:
            self.initial, self.history = after.initial, list(after.history)
            self.steps_done = self.history[-1].iteration if self.history else 0
            pressures = after.pressures or pressures
            self.phases.update(after.seconds)
        if isinstance(after, CarriedDesign):
            spent = time.perf_counter() - self.begin
            self.phases[SETUP] = self.phases.get(SETUP, 0.0) + spent
        self.x = self.variables.vector(fields.with_passive(x), pressures)

    def restore(self, saved: Archive) -> int:
        """Take up a saved state, but for the design and MMA's; return its stage."""
        numbers, before = saved.numbers, len(self.history)
        first = self.next_stage
        with fitting("loop"):
            self.x = self.variables.scatter(saved.arrays["x"])
            self.history = [Iteration(**row) for row in numbers["history"]]
            self.level, self.steps_done = int(numbers["level"]), int(numbers["steps_done"])
            self.change = float(numbers["change"])
            self.phases = dict(numbers["phases"])
            self.begin = time.perf_counter() - float(numbers["seconds"])
            stage = int(numbers["stage"])
            limits = list(map(int, numbers["iterations"]))
        over = self.options.stages[: stage - first]
        for k, (one, then) in enumerate(zip(over, limits, strict=False)):
            if one.iterations != then:
                soft = sum(self.soft) * (k == len(self.soft))  # of the stage that was given
                raise CheckpointError(
                    f"a stage of {then + soft} steps is over, and another one followed: "
                    f"{one.iterations + soft} steps change nothing. Go on with {then + soft}, or "
                    "start a new run."
                )
        restored = getattr(self.callback, "restored", None)
        if restored is not None:
            restored(self.history[before:])
        self.iteration_begin = time.perf_counter()
        return stage

    def checkpoint(self, number: int, steps: Steps, here: Evaluation) -> Archive:
        """Return the state after a row of the history (collective)."""
        arrays, numbers = saved_evaluation(here)
        of_steps, scales = steps.saved()
        arrays |= {"x": self.variables.gather(self.x), **of_steps}
        numbers |= {
            "stage": number,
            **scales,
            "level": self.level,
            "steps_done": self.steps_done,
            "change": self.change,
            "phases": self.phases,
            "iterations": [stage.iterations for stage in self.options.stages],
            "soft": list(self.soft),
            "seconds": time.perf_counter() - self.begin,
            "history": [{**vars(row), "metrics": dict(row.metrics)} for row in self.history],
        }
        return Archive(KIND, arrays, numbers)

    def stage(self, number: int, stage: Stage, saved: Archive | None, *, last: bool) -> None:
        """Run one stage from the current design, or from a saved state of it (fig. 2)."""
        problem = self.problem
        if stage.beta is not None:
            problem = problem.changed(fields=problem.fields.with_beta(stage.beta))
        if stage.first_pose is not None:
            problem = problem.changed(importance=stage.first_pose * problem.importance)
        found = self.first_design(problem, number, saved)
        if found is None:
            return
        here, slopes = self.accepted(found)
        steps = Steps(problem, self.variables, stage, self.options, here, slopes)
        if saved is not None:
            with fitting("loop"):
                steps.restore(saved)
        known, first = saved is not None, saved is None
        while True:
            with self.timed("mma"):
                functions = steps.around(here, slopes)
                if not known:
                    kkt = math.inf if first else steps.mma.kkt_residual(self.x, functions)
            if not known:
                self.steps_done += not first
                self.record(number, here, slopes, kkt)
            ended = self.ended(problem, stage, number, last=last)
            if not known:
                self.entry.offer(partial(self.checkpoint, number, steps, here), last=ended)
            if ended:
                return
            there = self.next_design(problem, steps, here, functions)
            if there is None:
                self.entry.offer(partial(self.checkpoint, number, steps, here), last=True)
                self.over = True
                self.reason = "The last step has no equilibrium; this is the last design with one."
                return
            here, slopes = self.accepted(there)
            known = first = False

    def first_design(
        self, problem: DesignProblem, number: int, saved: Archive | None
    ) -> Evaluation | None:
        """Return the design that a stage starts from; None, and the end, without equilibrium."""
        if saved is not None:
            return restored_evaluation(problem, saved)
        # A start from another mesh or print has rounding of its own.
        self.x = rounded(self.x, resolution_of(self.options))
        try:
            return self.simulated(problem, self.start)
        except NoEquilibriumError:
            if self.here is None:
                raise
            self.over, self.reason = True, f"Stage {number} has no equilibrium to start from."
            return None

    def next_design(
        self, problem: DesignProblem, steps: Steps, near: Evaluation, here: Functions
    ) -> Evaluation | None:
        """Return the design that MMA proposes, or a more cautious one; None without equilibrium."""
        before, o, start = self.x, self.options, near.start
        with self.timed("mma"):
            self.x = steps.mma.step(before, here)
        merit = steps.merit()
        most = merit(here)
        while True:
            enough, last = self.rejected >= o.retries, self.rejected >= 2 * o.retries
            trial = self.attempt(partial(self.simulated, problem, start, trial=not last))
            there = steps.at(trial)
            if trial is not None and (enough or merit(there) <= most):
                trial = self.attempt(partial(self.finished, trial))
                there = steps.at(trial)
            if trial is not None and (enough or merit(there) <= most):
                self.change = largest(self.comm, np.max(np.abs(self.x - before), initial=0.0))
                return trial
            if last:
                self.x = before
                return None
            self.rejected += 1
            self.x = steps.mma.retry(self.x, there)

    def accepted(self, design: Evaluation) -> tuple[Evaluation, Slopes]:
        """Take a design as the current one; return it with its gradients (collective)."""
        with self.timed("adjoint"):
            slopes = design.problem.differentiate(design)
        self.here, self.start = design, design.start
        return design, slopes

    def simulated(self, problem: DesignProblem, start: Any, *, trial: bool = False) -> Evaluation:
        """Simulate the design that the variables stand for (collective)."""
        density, pressures = self.variables.design(self.x)
        return self.counted(lambda: problem.simulate(density, start, pressures, trial=trial))

    def finished(self, trial: Evaluation) -> Evaluation:
        """Complete a trial (collective)."""
        return self.counted(lambda: trial.problem.finish(trial), trial)

    def attempt(self, action: Callable[[], Evaluation]) -> Evaluation | None:
        """Return what an action returns; None if it finds no equilibrium."""
        try:
            return action()
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

    @contextmanager
    def timed(self, phase: str) -> Iterator[None]:
        """Add the time of a block to a phase."""
        begin = time.perf_counter()
        yield
        self.phases[phase] += time.perf_counter() - begin

    def ended(self, problem: DesignProblem, stage: Stage, number: int, *, last: bool) -> bool:
        """Return whether the stage ends here, and mark the end of the loop; equal on all ranks."""
        limit = self.options.seconds
        if limit is not None:
            # Ranks that share directions have a skin each, and must end together.
            spent = largest(problem.comm, time.perf_counter() - self.begin)
            if spent > limit:
                self.over, self.reason = True, f"{limit:g} s have passed."
                return True
        rows = [row for row in self.history if row.stage == number]
        bounds = None if problem.length_scale is None else problem.length_scale.epsilon
        found = reason_to_end(rows, stage, self.options, bounds)
        if found is None:
            return False
        self.over, self.reason = last, found
        return True

    def record(self, number: int, here: Evaluation, slopes: Slopes, kkt: float) -> None:
        """Add a row to the history and show it to the callback (collective)."""
        e, fields = here, here.problem.fields
        volume_fraction, grey_level = fields.reinforcement(e.projected)
        g_r, g_t = (0.0, 0.0) if e.length_scale is None else map(float, e.length_scale)
        row = Iteration(
            iteration=self.steps_done,
            stage=number,
            level=self.level,
            objective=e.objective,
            shape=self.problem.shape_of_poses(e),
            perimeter=e.perimeter or 0.0,
            g_r=g_r,
            g_t=g_t,
            pressure=max(e.equilibrium.pressures, default=0.0),
            gradient_norm=norm(self.comm, slopes.gradient),
            kkt=kkt,
            volume_fraction=volume_fraction,
            grey_level=grey_level,
            change=self.change,
            beta=fields.beta,
            rejected=self.rejected,
            newton_steps=self.steps,
            factorisations=self.factorisations,
            seconds=time.perf_counter() - self.iteration_begin,
            metrics=e.metrics,
        )
        self.steps = self.factorisations = self.rejected = 0
        self.iteration_begin = time.perf_counter()
        self.history.append(row)
        if self.callback is not None:
            self.callback(row, e)
