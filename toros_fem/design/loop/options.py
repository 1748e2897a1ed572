"""Stages, stop rules and step control of the design loop, and the rows of its history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    require_between,
    require_count,
    require_flag,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.design.mma.optimizer import MMAOptions

# Number of steps over which T must fall.
LOOK_BACK = 10


@dataclass(frozen=True)
class Stage:
    """A part of the design loop in which the problem does not change.

    MMA starts afresh with each stage. Where β is raised or constraints are switched on, T jumps,
    and asymptotes learnt on the old problem would mislead MMA.

    Attributes:
        iterations: Largest number of MMA steps.
        beta: Steepness β of the projection; None keeps the problem's.
        constrained: Whether the problem's width constraints are enforced; they are reported
            in either case.
        robust: Whether the eroded and dilated patterns of a robust problem count.
    """

    iterations: int
    beta: float | None = None
    constrained: bool = False
    robust: bool = True

    def __post_init__(self) -> None:
        require_count(1, iterations=self.iterations)
        require_flag(constrained=self.constrained, robust=self.robust)
        if self.beta is not None:
            require_positive(beta=self.beta)


@dataclass(frozen=True)
class DesignOptions:
    """Stages, stop rules and step control of the design loop.

    Attributes:
        stages: The stages, run one after the other.
        retries: How often a step that does not decrease the merit function is replaced by a more
            cautious one; then it is accepted. A step without an equilibrium is replaced up to
            twice as often and never accepted.
        x_tol: A stage ends when no variable changes by more than this.
        kkt_tol: A stage ends when the KKT residual of MMA's scaled problem is below this.
        target_objective: A stage ends when T is at most this and its constraints hold; None leaves
            this rule out.
        min_relative_decrease: A stage ends when T fell by a smaller fraction in the last ten
            steps, its constraints satisfied before and after; None leaves this rule out.
        seconds: The loop ends after this wall time; None leaves this rule out.
        pressure_move: Largest change of a pressure in one step, as a fraction of the logarithm of
            its bounds' ratio.
        mma: Parameters of MMA.

    Raises:
        ParameterError: There is no stage, or a value is out of its bounds.
    """

    stages: tuple[Stage, ...] = (Stage(60),)
    retries: int = 4
    x_tol: float = 1e-4
    kkt_tol: float = 1e-5
    target_objective: float | None = None
    min_relative_decrease: float | None = None
    seconds: float | None = None
    pressure_move: float = 0.1
    mma: MMAOptions = field(default_factory=MMAOptions)

    def __post_init__(self) -> None:
        if not isinstance(self.stages, list | tuple):
            raise ParameterError(f"stages = {shown(self.stages)} must be a list of Stages.")
        for stage in self.stages:
            require_kind("stages", stage, Stage, "Stages, by Stage(iterations)")
        object.__setattr__(self, "stages", tuple(self.stages))
        require_kind("mma", self.mma, MMAOptions, "MMAOptions")
        if not self.stages:
            raise ParameterError("stages is empty; give at least one Stage.")
        require_count(0, retries=self.retries)
        require_positive(x_tol=self.x_tol, kkt_tol=self.kkt_tol)
        if self.target_objective is not None:
            require_between(0.0, np.inf, target_objective=self.target_objective)
        if self.min_relative_decrease is not None:
            require_between(0.0, 1.0, min_relative_decrease=self.min_relative_decrease)
        require_positive(pressure_move=self.pressure_move, at_most=1.0)
        if self.seconds is not None:
            require_positive(seconds=self.seconds)

    @property
    def iterations(self) -> int:
        """Largest number of MMA steps over all stages."""
        return sum(stage.iterations for stage in self.stages)


@dataclass(frozen=True)
class Iteration:
    """One row of the design loop's history.

    Attributes:
        iteration: Steps taken so far, through all stages; the start of a stage repeats a number.
        stage: Number of the stage, from 0, through all meshes.
        level: Number of the mesh, from 0, the coarsest.
        objective: T.
        shape: Its part that measures the distance from the target.
        perimeter: Length in m of the print's border; 0 without a perimeter term.
        g_r, g_t: Width constraints of eqs. (13, 14); 0 without them.
        pressure: In Pa, the largest of all chambers.
        gradient_norm: Euclidean norm of dT/dρ over all triangles.
        kkt: KKT residual of MMA's scaled problem; infinite before the first step of a stage.
        volume_fraction: Fraction of the designed area that is reinforced.
        grey_level: Mean of 4 ρ̄ (1 − ρ̄) over the designed area: 0 for a binary design.
        change: Largest change of a variable in this step.
        beta: Steepness of the projection; 0 where nothing is projected.
        rejected: Number of rejected trial designs in this step.
        newton_steps, factorisations: Of all equilibrium solves, rejected trials included.
        seconds: Wall time of the iteration.
        metrics: Values of the problem's metrics, by key.
    """

    iteration: int
    stage: int
    level: int
    objective: float
    shape: float
    perimeter: float
    g_r: float
    g_t: float
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
    metrics: Mapping[str, float]

    def columns(self) -> dict[str, float]:
        """Return the row as columns of a table, metrics included."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "metrics"}
        return {**own, **self.metrics}


def reason_to_end(
    rows: Sequence[Iteration],
    stage: Stage,
    options: DesignOptions,
    bounds: Floats | None,
) -> str | None:
    """Return why a stage of these rows, the start included, ends, as a sentence; None to go on.

    The bounds are those of g_r and g_t, where the problem has them.
    """
    o, now, steps = options, rows[-1], len(rows) - 1

    def kept(row: Iteration) -> bool:
        if not stage.constrained or bounds is None:
            return True
        return bool(row.g_r <= bounds[0] and row.g_t <= bounds[1])

    def slow() -> bool:
        before, fraction = rows[-1 - LOOK_BACK], o.min_relative_decrease
        if fraction is None or not (kept(before) and kept(now)):
            return False
        return now.objective > before.objective - fraction * abs(before.objective)

    if steps > 0 and now.kkt < o.kkt_tol:
        return f"The KKT residual is under {o.kkt_tol:g}."
    if steps > 0 and now.change < o.x_tol:
        return f"No variable changes by more than {o.x_tol:g} any more."
    if o.target_objective is not None and now.objective <= o.target_objective and kept(now):
        return f"T is at most {o.target_objective:g}."
    if steps >= LOOK_BACK and slow():
        return f"T fell by less than {o.min_relative_decrease:g} of it in {LOOK_BACK} steps."
    if steps == stage.iterations:
        return f"All {stage.iterations} iterations of the last stage are done."
    return None
