"""Stages, stop rules and step control of the design loop, and the rows of its history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from itertools import pairwise
from typing import Annotated

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Count, Factor, Flag, Fraction, In, Number, Positive, Table, key
from toros_fem.base.validation import Floats
from toros_fem.design.mma.optimizer import MMAOptions

# What a stage may end below: smaller numbers are rounding.
Tolerance = Annotated[float, In(at_least=1e-15)]
# Number of steps over which T must fall.
LOOK_BACK = 10
# A design whose miss grows by more than this from the end of an earlier stage has lost the shape.
LOST = 2.0
# A soft start: parts of the steps of a first stage, and β there over that of the problem.
SOFT_START = ((0.3, 0.2), (0.3, 0.4))
# Factor on the weight of the first of several poses in the stage that a design begins with.
FIRST_POSE = 100.0


class Stage(Table):
    """A part of the design loop in which the problem does not change.

    MMA starts afresh with each stage. Where β is raised or constraints are switched on, T jumps,
    and asymptotes learnt on the old problem would mislead MMA.
    """

    iterations: Count = key(MISSING, "largest number of MMA steps")
    beta: Positive | None = key(None, "steepness β of the projection; none keeps the problem's")
    constrained: Flag = key(
        False, "whether the problem's width constraints are enforced; they are reported either way"
    )
    tighten: Annotated[float, In(above=0, below=1)] = key(
        0.5, "target of a violated constraint in each step, over its value"
    )
    first_pose: Positive | None = key(
        None, "factor on the weight of the first of several poses; none for none"
    )


class DesignOptions(Table):
    """Stages, stop rules and step control of the design loop.

    A step that does not decrease the merit function is replaced by a more cautious one, `retries`
    times at most; then it is accepted. One without an equilibrium is replaced up to twice as often
    and never accepted.

    Raises:
        ParameterError: There is no stage, or a value is out of its bounds.
    """

    stages: tuple[Stage, ...] = key((Stage(60),), "the stages, run one after the other")
    soft_start: Flag = key(
        True,
        "whether a first stage that starts from noise begins with a fifth, then two fifths of β, "
        "unless it sets β",
    )
    retries: Number = key(4, "how often a step is replaced by a more cautious one")
    x_tol: Tolerance = key(1e-4, "a stage ends when no variable changes by more than this")
    kkt_tol: Tolerance = key(
        1e-5, "a stage ends when the KKT residual of MMA's scaled problem is below this"
    )
    target_objective: Factor | None = key(
        None, "a stage ends when T is at most this and its constraints hold"
    )
    min_relative_decrease: Annotated[float, In(at_least=0, at_most=1)] | None = key(
        None,
        "a stage ends when T fell by a smaller fraction in the last ten steps, its constraints "
        "satisfied before and after",
    )
    seconds: Positive | None = key(None, "the loop ends after this wall time in s")
    pressure_move: Fraction = key(
        0.07, "largest change of a pressure in one step, as a fraction of it"
    )
    mma: MMAOptions = key(MMAOptions(), "parameters of MMA")

    def __post_init__(self) -> None:
        if not self.stages:
            raise ParameterError("stages is empty; give at least one Stage.")

    @property
    def iterations(self) -> int:
        """Largest number of MMA steps over all stages."""
        return sum(stage.iterations for stage in self.stages)

    def with_first_pose(self) -> DesignOptions:
        """Return options that begin with the first stage, in which the first pose counts most.

        From noise, designs for several pressures at once end in traps that one for each avoids.
        """
        first = replace(self.stages[0], first_pose=FIRST_POSE)
        return self.updated(stages=(first, *self.stages))

    def soft_steps(self) -> tuple[int, ...]:
        """Return the steps of the parts of a soft start, taken from those of the first stage."""
        first = self.stages[0]
        if not self.soft_start or first.beta is not None:
            return ()
        return tuple(filter(None, (int(part * first.iterations) for part, _ in SOFT_START)))

    def softened(self, beta: float, steps: Sequence[int]) -> DesignOptions:
        """Return options whose first stage is divided for a soft start towards β, by these steps.

        With the full β, noise becomes a pattern in one step and freezes (docs/theory/design.md).
        """
        if not steps:
            return self
        first, *others = self.stages
        soft = [
            replace(first, iterations=count, beta=factor * beta)
            for count, (_, factor) in zip(steps, SOFT_START[-len(steps) :], strict=True)
        ]
        rest = replace(first, iterations=max(1, first.iterations - sum(steps)))
        return self.updated(stages=(*soft, rest, *others))


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


def growth_of_miss(rows: Sequence[Iteration], shape: float) -> float:
    """Return the miss of a design over the least one at the end of a stage before.

    The miss is the root of the shape's part of T, a distance over the skin's size. Stages with a
    smaller β, whose patterns are grey, do not count; line families have no β, and a growth of 1.
    """
    last = rows[-1]
    ends = [
        row.shape
        for row, after in pairwise(rows)
        if after.stage != row.stage and row.beta >= last.beta > 0
    ]
    least = max(min(ends, default=shape), float(np.finfo(float).tiny))
    return float(np.sqrt(shape / least))


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
