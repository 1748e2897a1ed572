"""The design loop: MMA on the densities, steps that raise the objective tried again."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from toros_fem._mpi import dot, largest, norm, total
from toros_fem.density import check_density
from toros_fem.design import DesignProblem, Evaluation
from toros_fem.equilibrium import EquilibriumError
from toros_fem.mma import MMA, MMAOptions
from toros_fem.parameters import require_positive
from toros_fem.projection import Continuation, Projection

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Iteration:
    """One line of the design loop's history.

    Attributes:
        iteration: Counted from 0.
        objective: T.
        gradient_norm: Euclidean norm of dT/dρ over all triangles.
        volume_fraction: Share of the designed area that is reinforced.
        grey_level: Mean of 4 ρ̄ (1 − ρ̄) over the designed area: 0 for a binary design.
        change: Largest change of a density by the step that led here.
        beta: Steepness of the projection.
        rejected: Designs tried and rejected on the way here, because T rose.
        newton_steps, factorisations: Of the equilibrium solves, those of rejected designs too.
        seconds: Wall time of the iteration.
    """

    iteration: int
    objective: float
    gradient_norm: float
    volume_fraction: float
    grey_level: float
    change: float
    beta: float
    rejected: int
    newton_steps: int
    factorisations: int
    seconds: float


@dataclass(frozen=True, eq=False)
class DesignResult:
    """What the design loop arrived at.

    Attributes:
        density: Final ρ at owned triangles: the last design, which is the best one unless all
            retries of a step failed to lower T, or β was raised.
        final: Its evaluation.
        history: One row an iteration, the last one being the final design.
        reason: Why the loop ended, as a sentence.
        seconds: Wall time by phase.
        designed: Which owned triangles were designed, not given.
    """

    density: Floats
    final: Evaluation
    history: tuple[Iteration, ...]
    reason: str
    seconds: dict[str, float]
    designed: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class DesignOptions:
    """When the loop stops, and how it steps.

    Attributes:
        iterations: MMA steps.
        retries: How often a step that raises T is tried again more cautiously; then it is taken.
        change: Stop when no density changes by more than this.
        mma: Parameters of MMA.
        continuation: Schedule of β; None keeps the projection as it is.
    """

    iterations: int = 60
    retries: int = 4
    change: float = 1e-4
    mma: MMAOptions = field(default_factory=MMAOptions)
    continuation: Continuation | None = None

    def __post_init__(self) -> None:
        require_positive(iterations=self.iterations, change=self.change)


Callback = Callable[[Iteration, Evaluation], None]


def optimise(
    problem: DesignProblem,
    density: Floats,
    options: DesignOptions | None = None,
    callback: Callback | None = None,
) -> DesignResult:
    """Minimise T over the densities by MMA (collective).

    Args:
        problem: What to design; its `projection` is replaced when β is raised.
        density: Start ρ at owned triangles, in [0, 1].
        options: When to stop.
        callback: Called after each iteration, on every rank.

    Raises:
        DensityError: The density does not fit or leaves [0, 1].
        EquilibriumError: There is no equilibrium for the start. Later failures are stepped back
            from.
    """
    options = options or DesignOptions()
    skin = problem.solver.skin
    comm = skin.comm
    check_density(skin, density)
    if options.continuation is not None:
        problem.projection = Projection(options.continuation.beta(0), problem.projection.eta)
    designed = problem.designed
    areas = skin.pattern.areas[skin.owned_cells] * designed
    designed_area = total(comm, areas.sum())
    x = PETSc.Vec().createWithArray(density.copy(), comm=comm)
    gradient = x.duplicate()
    lower, upper = x.duplicate(), x.duplicate()
    lower.array[:] = np.where(designed, 0.0, density)
    upper.array[:] = np.where(designed, 1.0, density)
    mma = MMA(lower, upper, options=options.mma)
    history: list[Iteration] = []
    work = _Work(problem)
    rejected, change, scale = 0, 0.0, 1.0
    begin = time.perf_counter()
    evaluation = work.simulate(density, None)
    reason = f"All {options.iterations} iterations are done."
    for iteration in range(options.iterations + 1):
        evaluation = problem.differentiate(evaluation)
        work.phases["adjoint"] += evaluation.seconds["adjoint"]
        grey = 4 * evaluation.projected * (1 - evaluation.projected)
        assert evaluation.gradient is not None
        row = Iteration(
            iteration=iteration,
            objective=evaluation.objective,
            gradient_norm=norm(comm, evaluation.gradient),
            volume_fraction=dot(comm, areas, evaluation.projected) / designed_area,
            grey_level=dot(comm, areas, grey) / designed_area,
            change=change,
            beta=problem.projection.beta,
            rejected=rejected,
            newton_steps=work.steps,
            factorisations=work.factorisations,
            seconds=time.perf_counter() - begin,
        )
        history.append(row)
        if callback is not None:
            callback(row, evaluation)
        if iteration == options.iterations:
            break
        final_beta = options.continuation is None or row.beta >= options.continuation.last
        if iteration > 0 and change < options.change and final_beta:
            reason = f"No density changes by more than {options.change:g} any more."
            break
        begin = time.perf_counter()
        work.steps = work.factorisations = rejected = 0
        if iteration == 0:  # MMA wants an objective of O(1) to O(100)
            scale = 10.0 / max(evaluation.objective, np.finfo(float).tiny)
        before = x.array.copy()
        gradient.array[:] = scale * evaluation.gradient
        mma.step(x, scale * evaluation.objective, gradient)
        work.phases["mma"] += time.perf_counter() - begin
        projection = problem.projection
        if options.continuation is not None:
            beta = options.continuation.beta(iteration + 1)
            problem.projection = Projection(beta, projection.eta)
        # A step of β raises T by itself: then there is nothing to compare with.
        bound = evaluation.objective if problem.projection == projection else np.inf
        start = evaluation.equilibrium.state
        trial = work.attempt(x.array.copy(), start)
        while rejected < options.retries and (trial is None or trial.objective > bound):
            rejected += 1
            mma.retry(x, np.inf if trial is None else scale * trial.objective)
            trial = work.attempt(x.array.copy(), start)
        if trial is None:
            x.array[:] = before
            problem.projection = projection
            reason = "No step led to a design that has an equilibrium; this is the last one."
            break
        change = largest(comm, np.max(np.abs(x.array - before), initial=0.0))
        evaluation = trial
    return DesignResult(x.array.copy(), evaluation, tuple(history), reason, work.phases, designed)


class _Work:
    """Simulates designs and adds up what it costs, that of failures included."""

    def __init__(self, problem: DesignProblem) -> None:
        self._problem = problem
        self.steps = self.factorisations = 0
        self.phases = {"filter": 0.0, "equilibrium": 0.0, "adjoint": 0.0, "mma": 0.0}

    def simulate(self, density: Floats, start: Floats | None) -> Evaluation:
        begin = time.perf_counter()
        try:
            found = self._problem.simulate(density, start)
        except EquilibriumError as error:
            self.steps += error.result.steps
            self.factorisations += error.result.factorisations
            self.phases["equilibrium"] += time.perf_counter() - begin
            raise
        self.steps += found.equilibrium.steps
        self.factorisations += found.equilibrium.factorisations
        for phase, seconds in found.seconds.items():
            self.phases[phase] += seconds
        return found

    def attempt(self, density: Floats, start: Floats) -> Evaluation | None:
        try:
            return self.simulate(density, start)
        except EquilibriumError:  # raised by all ranks or by none
            return None
