"""What the design loop does when: stages, stop rules, and the rows of its history."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from toros_fem._validate import require_between, require_choice, require_count, require_positive
from toros_fem.errors import ParameterError
from toros_fem.mma.optimizer import MMAOptions

DESCENTS = ("merit", "conservative")


@dataclass(frozen=True)
class Stage:
    """A part of the design loop throughout which the problem is one and the same.

    MMA starts afresh with each stage: where β is raised or constraints are switched on, T
    jumps, and what MMA knew of the old problem would mislead it.

    Attributes:
        iterations: MMA steps at most.
        beta: Steepness β of the projection; None keeps that of the problem.
        constrained: Whether the problem's length-scale constraints hold; they are reported
            either way.
    """

    iterations: int
    beta: float | None = None
    constrained: bool = False

    def __post_init__(self) -> None:
        require_count(1, iterations=self.iterations)
        if self.beta is not None:
            require_positive(beta=self.beta)


def doubling(first: float, last: float, every: int) -> tuple[Stage, ...]:
    """Stages in which β doubles from a soft start to its final value, the last one included.

    Args:
        first: β of the first stage.
        last: β of the last one.
        every: Iterations of each.
    """
    require_positive(first=first)
    require_between(first, float("inf"), last=last)
    betas = [first]
    while betas[-1] < last:
        betas.append(min(2 * betas[-1], last))
    return tuple(Stage(every, beta) for beta in betas)


@dataclass(frozen=True)
class DesignOptions:
    """When the loop stops, and how it steps.

    Attributes:
        stages: What is done one after the other.
        retries: How often a step that is no progress is tried again more cautiously; then it is
            taken. One without an equilibrium is tried again twice as often and never taken.
        x_tol: A stage ends when no variable changes by more than this.
        kkt_tol: A stage ends when the KKT residual of MMA's scaled problem falls under this.
        target_objective: A stage ends when T is at most this and its constraints hold; 0: never.
        min_relative_decrease: A stage ends when T fell by a smaller fraction in the last ten
            steps, its constraints satisfied before and after; 0: never.
        seconds: The loop ends after so much wall time; None: never.
        descent: What counts as progress. "merit": T plus the price of violated constraints does
            not rise. "conservative": GCMMA's own rule, by which every approximation bounds what
            it stands for (Svanberg 2002): given retries enough (15, say) descent is guaranteed,
            steps are shorter.
        pressure_move: Largest change of the pressure in one iteration, as a share of the
            logarithm of its bounds' ratio.
        mma: Parameters of MMA.
    """

    stages: tuple[Stage, ...] = (Stage(60),)
    retries: int = 4
    x_tol: float = 1e-4
    kkt_tol: float = 1e-5
    target_objective: float = 0.0
    min_relative_decrease: float = 0.0
    seconds: float | None = None
    descent: str = "merit"
    pressure_move: float = 0.1
    mma: MMAOptions = field(default_factory=MMAOptions)

    def __post_init__(self) -> None:
        if not self.stages:
            raise ParameterError("stages is empty: there is nothing to do.")
        require_count(0, retries=self.retries)
        require_positive(x_tol=self.x_tol, kkt_tol=self.kkt_tol)
        require_between(0.0, np.inf, target_objective=self.target_objective)
        require_between(0.0, 1.0, min_relative_decrease=self.min_relative_decrease)
        require_positive(pressure_move=self.pressure_move, at_most=1.0)
        require_choice("descent", self.descent, DESCENTS)
        if self.seconds is not None:
            require_positive(seconds=self.seconds)

    @property
    def iterations(self) -> int:
        """MMA steps at most, over all stages."""
        return sum(stage.iterations for stage in self.stages)


@dataclass(frozen=True)
class Iteration:
    """One line of the design loop's history.

    Attributes:
        iteration: Steps taken so far, through all stages; the start of a stage repeats a number.
        stage: Counted from 0.
        objective: T.
        shape: Its part that measures the distance from the target.
        perimeter: Length in m of the print's border; 0 where nothing asks for it.
        solid, void: g_r and g_t of eqs. (13, 14); 0 where nothing asks for them.
        pressure: In Pa, the largest of all chambers.
        gradient_norm: Euclidean norm of dT/dρ over all triangles.
        kkt: KKT residual of MMA's scaled problem; infinite before the first step of a stage.
        volume_fraction: Share of the designed area that is reinforced.
        grey_level: Mean of 4 ρ̄ (1 − ρ̄) over the designed area: 0 for a binary design.
        change: Largest change of a variable by the step that led here.
        beta: Steepness of the projection.
        rejected: Designs tried and rejected on the way here.
        newton_steps, factorisations: Of the equilibrium solves, those of rejected designs too.
        seconds: Wall time of the iteration.
    """

    iteration: int
    stage: int
    objective: float
    shape: float
    perimeter: float
    solid: float
    void: float
    pressure: float
    gradient_norm: float
    kkt: float
    volume_fraction: float
    grey_level: float
    change: float
    beta: float
    rejected: int
    newton_steps: int
    factorisations: int
    seconds: float
