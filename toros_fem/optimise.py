"""The design loop: density to filter to projection to equilibrium to objective, and back."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from toros_fem._mpi import dot, largest, norm, total
from toros_fem.equilibrium import EquilibriumResult, EquilibriumSolver
from toros_fem.errors import EquilibriumError
from toros_fem.filters import ConeFilter, check_density
from toros_fem.mma import MMA, MMAOptions, MMAState
from toros_fem.objective import ShapeObjective
from toros_fem.parameters import require_positive
from toros_fem.projection import Continuation, Projection

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One pass through the chain ρ → ρ̃ → ρ̄ → x → T and back.

    Attributes:
        objective: T.
        gradient: dT/dρ at owned triangles, zero where the density is not designed; None if it
            was not asked for.
        filtered, projected: ρ̃ and ρ̄ at owned triangles.
        equilibrium: The simulated shape.
        seconds: Wall time by phase, on this rank.
    """

    objective: float
    gradient: Floats | None
    filtered: Floats
    projected: Floats
    equilibrium: EquilibriumResult
    seconds: dict[str, float]


@dataclass(eq=False)
class DesignProblem:
    """A scene and what is wanted of it.

    Attributes:
        solver: Equilibrium solver of the scene.
        objective: Distance from the target.
        filter: Filter on the flat panels.
        pressure: Pressure in Pa.
        projection: Smoothed step; replaced by the loop when β is raised.
        passive: Projected density that is given, at owned triangles; NaN where it is designed.
            None designs every triangle.
    """

    solver: EquilibriumSolver
    objective: ShapeObjective
    filter: ConeFilter
    pressure: float
    projection: Projection = field(default_factory=Projection)
    passive: Floats | None = None

    @property
    def designed(self) -> npt.NDArray[np.bool_]:
        """Which owned triangles are designed."""
        if self.passive is None:
            return np.ones(len(self.solver.skin.owned_cells), dtype=bool)
        return np.isnan(self.passive)

    def fields(self, density: Floats) -> tuple[Floats, Floats]:
        """ρ̃ and ρ̄ of a density (collective)."""
        filtered = self.filter.forward(density)
        projected = self.projection.forward(filtered)
        if self.passive is not None:
            projected = np.where(self.designed, projected, self.passive)
        return filtered, projected

    def simulate(self, density: Floats, start: Floats | None = None) -> Evaluation:
        """T without its gradient, by one equilibrium, eq. (17) (collective).

        Args:
            density: ρ at owned triangles, in [0, 1].
            start: Positions to start the equilibrium from, of a neighbouring design say.

        Raises:
            DensityError: The density does not fit or leaves [0, 1].
            EquilibriumError: There is no equilibrium for this design.
        """
        check_density(self.solver.skin, density)
        begin = time.perf_counter()
        filtered, projected = self.fields(density)
        middle = time.perf_counter()
        equilibrium = self.solver.solve(projected, self.pressure, start=start)
        objective = self.objective.forward(equilibrium.state)
        seconds = {"filter": middle - begin, "equilibrium": time.perf_counter() - middle}
        return Evaluation(objective, None, filtered, projected, equilibrium, seconds)

    def differentiate(self, evaluation: Evaluation) -> Evaluation:
        """Add dT/dρ to the last simulation, by one adjoint solve, eqs. (18, 19) (collective)."""
        begin = time.perf_counter()
        state = evaluation.equilibrium.state
        adjoint = self.solver.solve_tangent(self.objective.backward(state))
        by_projected = -self.solver.model.density_sensitivity(state, adjoint) * self.designed
        by_filtered = self.projection.backward(evaluation.filtered, by_projected)
        gradient = self.filter.backward(by_filtered) * self.designed
        seconds = {**evaluation.seconds, "adjoint": time.perf_counter() - begin}
        return replace(evaluation, gradient=gradient, seconds=seconds)

    def evaluate(self, density: Floats, start: Floats | None = None) -> Evaluation:
        """T and dT/dρ: `simulate`, then `differentiate` (collective)."""
        return self.differentiate(self.simulate(density, start))


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
        density: Final ρ at owned triangles.
        final: Its evaluation.
        history: One row an iteration, the last one being the final design.
        reason: Why the loop ended, as a sentence.
        seconds: Wall time by phase.
        designed: Which owned triangles were designed, not given.
        optimiser: State of MMA, from which a run resumes.
    """

    density: Floats
    final: Evaluation
    history: tuple[Iteration, ...]
    reason: str
    seconds: dict[str, float]
    designed: npt.NDArray[np.bool_]
    optimiser: MMAState


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
        callback: Called after each evaluation, on every rank.
    """
    options = options or DesignOptions()
    skin = problem.solver.skin
    comm = skin.comm
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
    phases: dict[str, float] = {"filter": 0.0, "equilibrium": 0.0, "adjoint": 0.0, "mma": 0.0}

    def attempt(start: Floats) -> Evaluation | None:
        try:
            return simulate(start)
        except EquilibriumError:  # raised by all ranks or by none
            return None

    def simulate(start: Floats | None) -> Evaluation:
        found = problem.simulate(x.array.copy(), start)
        _add(phases, found.seconds)
        work[0] += found.equilibrium.steps
        work[1] += found.equilibrium.factorisations
        return found

    work = [0, 0]
    rejected, change, scale = 0, 0.0, 1.0
    begin = time.perf_counter()
    evaluation = simulate(None)
    reason = f"All {options.iterations} iterations are done."
    for iteration in range(options.iterations + 1):
        evaluation = problem.differentiate(evaluation)
        phases["adjoint"] += evaluation.seconds["adjoint"]
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
            newton_steps=work[0],
            factorisations=work[1],
            seconds=time.perf_counter() - begin,
        )
        history.append(row)
        if callback is not None:
            callback(row, evaluation)
        if iteration == options.iterations:
            break
        if iteration > 0 and change < options.change:
            reason = f"No density changes by more than {options.change:g} any more."
            break
        begin = time.perf_counter()
        work, rejected = [0, 0], 0
        if iteration == 0:  # MMA wants an objective of O(1) to O(100)
            scale = 10.0 / max(evaluation.objective, np.finfo(float).tiny)
        before = x.array.copy()
        gradient.array[:] = scale * evaluation.gradient
        mma.step(x, scale * evaluation.objective, gradient)
        phases["mma"] += time.perf_counter() - begin
        projection = problem.projection
        if options.continuation is not None:
            beta = options.continuation.beta(iteration + 1)
            problem.projection = Projection(beta, problem.projection.eta)
        trial = attempt(evaluation.equilibrium.state)
        # A step of β raises T by itself: then there is nothing to compare with.
        same = problem.projection == projection
        while rejected < options.retries and (
            trial is None or (same and trial.objective > evaluation.objective)
        ):
            rejected += 1
            mma.retry(x, np.inf if trial is None else scale * trial.objective)
            trial = attempt(evaluation.equilibrium.state)
        if trial is None:
            x.array[:] = before
            problem.projection = projection
            reason = "No step led to a design that has an equilibrium; this is the last one."
            break
        change = largest(comm, np.max(np.abs(x.array - before), initial=0.0))
        evaluation = trial
    return DesignResult(
        x.array.copy(), evaluation, tuple(history), reason, phases, designed, mma.state
    )


def _add(phases: dict[str, float], seconds: dict[str, float]) -> None:
    for phase, value in seconds.items():
        phases[phase] += value
