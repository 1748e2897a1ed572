"""Solves at one level of the load, their history, and continuation from level to level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from toros_fem.base.array_types import Floats

# Until a level fails, a solve of at most this many steps makes the next increment four times as
# large.
EASY = 10


@dataclass(frozen=True)
class NewtonStep:
    """One row of a solve's history.

    Attributes:
        pressure: Largest pressure of the level, in Pa.
        residual: Norm of the first variation over the applied load before the step.
        energy: Energy in J before the step.
        shift: Regularisation added to the tangent, over its material part; 0 for pure Newton.
        step: Fraction of the step that was taken; 0 where it was refused, and in the row that ends
            a level.
        kind: "newton" with factors of this state, "cg" with older factors, "modified" with older
            tangent and factors, "coupled" with the derivative of friction by normal forces,
            "escape" from a saddle, "end".
        iterations: Number of Krylov iterations, those that were not enough included.
        seconds: Wall time of the step on this rank.
    """

    pressure: float
    residual: float
    energy: float
    shift: float
    step: float
    kind: str
    iterations: int
    seconds: float

    def __str__(self) -> str:
        kind = f"cg {self.iterations}" if self.kind == "cg" else self.kind
        return (
            f"{self.pressure:10.4g} Pa  {kind:8s}  residual {self.residual:8.2e}  "
            f"energy {self.energy:+.9e} J  shift {self.shift:7.1e}  step {self.step:7.1e}  "
            f"{self.seconds:6.3f} s"
        )


@dataclass(frozen=True, eq=False)
class Attempt:
    """Result of one solve at one level.

    Attributes:
        state: Owned unknowns where it ended.
        outcome: Converged reason of SNES: above 0 the state is an equilibrium.
        steps: Number of steps.
        history: One row for each step, and the row that ends the solve.
    """

    state: Floats
    outcome: int
    steps: int
    history: tuple[NewtonStep, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the state is an equilibrium."""
        return self.outcome > 0


@dataclass(frozen=True, eq=False)
class ContinuationResult:
    """Last equilibrium of a continuation.

    Attributes:
        state: The last equilibrium, or the start if there is none.
        load_factor: Its level; None if there is no equilibrium.
        outcome: Converged reason of SNES of the last attempt.
    """

    state: Floats
    load_factor: float | None
    outcome: int


def run_continuation(
    attempt: Callable[[Floats, float], Attempt],
    start: ContinuationResult,
    increment: float,
    least: float,
) -> ContinuationResult:
    """Raise a load factor to 1, by solves from a state at a level.

    `start` holds a state, its level and outcome; `least` is the smallest increment, over the level
    reached or the first increment, whichever is larger.
    """
    state, load_factor, outcome = start.state, start.load_factor, start.outcome
    first, fastest = increment, 4
    while load_factor is None or load_factor < 1.0:
        level = min(1.0, (load_factor or 0.0) + increment)
        found = attempt(state, level)
        outcome = found.outcome
        if found.converged:
            state, load_factor = found.state, level
            increment *= fastest if found.steps <= EASY else 2
            continue
        fastest = 2
        increment = (level - (load_factor or 0.0)) / 4
        if increment <= least * max(load_factor or 0.0, first):
            break
    return ContinuationResult(state, load_factor, outcome)
