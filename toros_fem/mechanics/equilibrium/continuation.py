"""Continuation in a load factor, with steps that grow on success and shrink on failure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from toros_fem.base.array_types import Floats

# Until a level fails, a solve of at most this many steps makes the next increment four times as
# large.
EASY = 10


@dataclass(frozen=True, eq=False)
class Attempt:
    """Result of one solve at one level.

    Attributes:
        state: Owned unknowns where it ended.
        outcome: Converged reason of SNES: above 0 the state is an equilibrium.
        steps: Number of steps.
    """

    state: Floats
    outcome: int
    steps: int

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
    top: float,
    increment: float,
    least: float,
) -> ContinuationResult:
    """Raise a load factor to the top.

    Args:
        attempt: Solves from a state at a level.
        start: State, level and outcome to start from.
        top: The requested level.
        increment: The first increment.
        least: Smallest increment, over the level reached or over the first increment, whichever
            is larger.
    """
    state, load_factor, outcome = start.state, start.load_factor, start.outcome
    first, fastest = increment, 4
    while load_factor is None or load_factor < top:
        level = min(top, (load_factor or 0.0) + increment)
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
