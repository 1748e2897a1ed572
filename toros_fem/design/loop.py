"""The design loop: MMA on densities and pressure, steps that are no progress tried again."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem._mpi import dot, largest, norm, total
from toros_fem._types import Floats
from toros_fem.density.field import check_density
from toros_fem.density.projection import Projection
from toros_fem.design.options import DesignOptions, Iteration, Stage
from toros_fem.design.problem import DesignProblem, Evaluation
from toros_fem.design.variables import Scaled, Values, Variables
from toros_fem.errors import NoEquilibriumError, ParameterError
from toros_fem.mma.optimizer import MMA

# Over so many steps T is to fall.
LOOK_BACK = 10
# What a violated constraint costs at least when progress is judged, in MMA's scaled units.
PRICE = 1.0


@dataclass(frozen=True, eq=False)
class DesignResult:
    """What the design loop arrived at.

    Attributes:
        density: Final ρ at owned triangles.
        pressure: Final pressure in Pa, the largest of all chambers.
        final: Evaluation of the two.
        history: One row for the start of each stage and one for each step, the last one being
            the final design.
        reason: Why the loop ended, as a sentence.
        seconds: Wall time by phase.
        designed: Which owned triangles were designed, not given.
    """

    density: Floats
    pressure: float
    final: Evaluation
    history: tuple[Iteration, ...]
    reason: str
    seconds: dict[str, float]
    designed: npt.NDArray[np.bool_]

    @property
    def pressures(self) -> tuple[float, ...]:
        """Final pressure of each chamber in Pa."""
        return self.final.equilibrium.pressures


Callback = Callable[[Iteration, Evaluation], None]


def optimize(
    problem: DesignProblem,
    density: Floats,
    options: DesignOptions | None = None,
    callback: Callback | None = None,
    *,
    after: DesignResult | None = None,
    new_mesh: bool = False,
) -> DesignResult:
    """Minimise T over densities and pressure by MMA, stage by stage (collective).

    Args:
        problem: What to design. It is left as it is; the stages work on copies.
        density: Start ρ at owned triangles, in [0, 1].
        options: Stages and stop rules.
        callback: Called after each iteration, on every rank.
        after: A result to go on from: its pressure, shape and history are continued, and only
            the density is the one given.
        resewn: Whether that result is of another mesh, so that its shape is no start.

    Raises:
        DensityError: The density does not fit or leaves [0, 1].
        ParameterError: A stage is constrained, the problem has no constraints.
        NoEquilibriumError: There is no equilibrium for the start. Later failures are stepped back
            from.
    """
    options = options or DesignOptions()
    check_density(problem.skin, density)
    if problem.length_scale is None and any(stage.constrained for stage in options.stages):
        raise ParameterError(
            "a stage asks for constraints on widths, but the problem has no length_scale."
        )
    loop = _Loop(problem, density, options, callback)
    if after is not None:
        loop.go_on(after, density, new_mesh=new_mesh)
    first = loop.history[-1].stage + 1 if loop.history else 0
    for number, stage in enumerate(options.stages, first):
        loop.run(number, stage, last=number - first == len(options.stages) - 1)
        if loop.over:
            break
    assert loop.evaluation is not None
    return DesignResult(
        density=loop.evaluation.density,
        pressure=loop.evaluation.equilibrium.pressure,
        final=loop.evaluation,
        history=tuple(loop.history),
        reason=loop.reason,
        seconds=loop.phases,
        designed=problem.designed,
    )


class _Loop:
    """The state of the design loop."""

    def __init__(
        self,
        problem: DesignProblem,
        density: Floats,
        options: DesignOptions,
        callback: Callback | None,
    ) -> None:
        self.problem, self.options, self.callback = problem, options, callback
        self.comm = problem.skin.comm
        self.variables = Variables(problem, options)
        self.x = self.variables.vector(problem.completed(density), problem.pressures)
        self.areas = problem.skin.pattern.areas[problem.skin.owned_cells]
        self.areas = self.areas * problem.designed
        self.evaluation: Evaluation | None = None
        self.history: list[Iteration] = []
        self.phases = {"filter": 0.0, "equilibrium": 0.0, "adjoint": 0.0, "mma": 0.0}
        self.steps = self.factorisations = self.rejected = 0
        self.change, self.steps_done = 0.0, 0
        self.begin = self.iteration_begin = time.perf_counter()
        self.over, self.reason = False, ""

    def go_on(self, result: DesignResult, density: Floats, *, new_mesh: bool) -> None:
        """Take over what a loop before arrived at, but for the density."""
        self.evaluation, self.history = None if new_mesh else result.final, list(result.history)
        self.phases, self.steps_done = dict(result.seconds), result.history[-1].iteration
        self.x = self.variables.vector(self.problem.completed(density), result.pressures)

    def run(self, number: int, stage: Stage, *, last: bool) -> None:
        """One stage, from the design at hand."""
        given, options = self.problem, self.options
        projection, constrained = given.projection, stage.constrained
        if stage.beta is not None:
            projection = Projection(stage.beta, projection.eta)
        self.problem = problem = given.with_projection(projection)
        start = None if self.evaluation is None else self.evaluation.equilibrium.state
        try:
            evaluation = self.simulate(start)
        except NoEquilibriumError:
            if self.evaluation is None:
                raise
            self.over, self.reason = True, f"Stage {number} has no equilibrium to start from."
            self.problem = given
            return
        mma = MMA(
            *self.variables.bounds,
            constraints=2 if constrained else 0,
            options=options.mma,
            move=self.variables.move,
            residuals=len(evaluation.residuals),
        )
        scaled = Scaled(
            problem,
            self.variables,
            constrained=constrained,
            target_objective=options.target_objective,
            start=evaluation,
        )
        kkt = math.inf
        for count in range(stage.iterations + 1):
            begin = time.perf_counter()
            self.evaluation = evaluation = problem.differentiate(evaluation)
            self.phases["adjoint"] += time.perf_counter() - begin
            begin = time.perf_counter()
            mma.rescale(scaled.refer(evaluation))
            here, slopes = scaled.values(evaluation), scaled.gradients(evaluation)
            if count > 0:
                kkt = mma.kkt(self.x, slopes.objective, here.constraints, slopes.constraints)
            self.phases["mma"] += time.perf_counter() - begin
            self.steps_done += count > 0
            self.record(number, evaluation, kkt)
            self.steps = self.factorisations = self.rejected = 0
            if self.finished(stage, count, kkt, last=last):
                break
            begin = time.perf_counter()
            before = self.x.array.copy()
            mma.step(
                self.x,
                here.rest,
                slopes.rest,
                here.constraints,
                slopes.constraints,
                here.residuals,
                slopes.residuals,
            )
            self.phases["mma"] += time.perf_counter() - begin
            trial = self.descend(mma, scaled, evaluation, here)
            if trial is None:
                self.x.array[:] = before
                self.over = True
                self.reason = "The last step has no equilibrium; this is the last design with one."
                break
            self.change = largest(self.comm, np.max(np.abs(self.x.array - before), initial=0.0))
            evaluation = trial
        self.problem = given

    def descend(
        self, mma: MMA, scaled: Scaled, near: Evaluation, here: Values
    ) -> Evaluation | None:
        """The design MMA proposes or a more cautious one; None if the last has no equilibrium."""
        o = self.options
        multipliers = np.asarray(mma.state.multipliers)[: len(here.constraints)]
        prices = np.maximum(PRICE, 2 * multipliers)

        def merit(values: Values) -> float:
            return values.objective + float(prices @ np.maximum(values.constraints, 0.0))

        bound = merit(here)
        while True:
            trial = self.attempt(near)
            there = here.missing if trial is None else scaled.values(trial)
            if trial is None:
                good = False
            elif o.descent == "conservative":
                good = mma.conservative(self.x, there.rest, there.constraints, there.residuals)
            else:
                good = merit(there) <= bound
            enough = self.rejected >= (2 * o.retries if trial is None else o.retries)
            if good or enough:
                return trial
            self.rejected += 1
            mma.retry(self.x, there.rest, there.constraints, there.residuals)

    def finished(self, stage: Stage, count: int, kkt: float, *, last: bool) -> bool:
        """Whether the stage ends here, and with it perhaps the loop; alike on all ranks."""
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
        elif 0 < o.target_objective >= now.objective and self.kept(stage, now):
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

    def kept(self, stage: Stage, row: Iteration) -> bool:
        """Whether the constraints of the stage hold."""
        if not stage.constrained:
            return True
        limits = self.problem.length_scale
        assert limits is not None
        return bool(row.solid <= limits.epsilon[0] and row.void <= limits.epsilon[1])

    def slow(self, stage: Stage) -> bool:
        """Whether T has hardly fallen of late, and not because constraints took hold."""
        before, now = self.history[-1 - LOOK_BACK], self.history[-1]
        kept = self.kept(stage, before) and self.kept(stage, now)
        least = self.options.min_relative_decrease * abs(before.objective)
        return kept and least > 0 and now.objective > before.objective - least

    def record(self, number: int, evaluation: Evaluation, kkt: float) -> None:
        e, whole = evaluation, total(self.comm, self.areas.sum())
        assert e.gradient is not None
        solid, void = (0.0, 0.0) if e.length_scale is None else map(float, e.length_scale)
        row = Iteration(
            iteration=self.steps_done,
            stage=number,
            objective=e.objective,
            shape=e.shape,
            perimeter=e.perimeter or 0.0,
            solid=solid,
            void=void,
            pressure=e.equilibrium.pressure,
            gradient_norm=norm(self.comm, e.gradient),
            kkt=kkt,
            volume_fraction=dot(self.comm, self.areas, e.projected) / whole,
            grey_level=dot(self.comm, self.areas, 4 * e.projected * (1 - e.projected)) / whole,
            change=self.change,
            beta=self.problem.projection.beta,
            rejected=self.rejected,
            newton_steps=self.steps,
            factorisations=self.factorisations,
            seconds=time.perf_counter() - self.iteration_begin,
        )
        self.iteration_begin = time.perf_counter()
        self.history.append(row)
        if self.callback is not None:
            self.callback(row, e)

    def simulate(self, start: Floats | None, *, allow_continuation: bool = True) -> Evaluation:
        """The design that the variables stand for; what it costs is added up."""
        begin = time.perf_counter()
        density, pressures = self.variables.design(self.x)
        try:
            found = self.problem.simulate(
                density, start, pressures, allow_continuation=allow_continuation
            )
        except NoEquilibriumError as error:
            self.steps += error.steps
            self.factorisations += error.factorisations
            self.phases["equilibrium"] += time.perf_counter() - begin
            raise
        self.steps += found.equilibrium.steps
        self.factorisations += found.equilibrium.factorisations
        for phase, seconds in found.seconds.items():
            self.phases[phase] += seconds
        return found

    def attempt(self, near: Evaluation) -> Evaluation | None:
        # A step that has no equilibrium near by is replaced; only the last try gets all effort.
        allow_continuation = self.rejected >= 2 * self.options.retries
        try:
            return self.simulate(near.equilibrium.state, allow_continuation=allow_continuation)
        except NoEquilibriumError:  # raised by all ranks or by none
            return None
