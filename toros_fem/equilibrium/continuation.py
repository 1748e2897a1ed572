"""Climbing to a load in steps that grow where they succeed and shrink where they fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from toros_fem._types import Floats

# Until a level fails, one reached in so many steps lets the next increment be four times as large.
EASY = 10


@dataclass(frozen=True, eq=False)
class ContinuationResult:
    """How far a climb came.

    Attributes:
        state: The last equilibrium, or the start if there is none.
        reached: Its level; None if none was found.
        outcome: How the last attempt ended, a converged reason of SNES.
    """

    state: Floats
    load_factor: float | None
    outcome: int


def run_continuation(
    attempt: Callable[[Floats, float], tuple[Floats, int, int]],
    start: ContinuationResult,
    top: float,
    increment: float,
    least: float,
) -> ContinuationResult:
    """Raise a level to the top.

    Args:
        attempt: Solves at a level from a state: the state found, how it ended (above 0 means an
            equilibrium), and the steps taken.
        start: Where to begin.
        top: The level wanted.
        increment: The first one.
        least: Smallest increment, over the level reached or the first increment if that is more.
    """
    state, load_factor, outcome = start.state, start.load_factor, start.outcome
    first, fastest = increment, 4
    while load_factor is None or load_factor < top:
        level = min(top, (load_factor or 0.0) + increment)
        found, outcome, steps = attempt(state, level)
        if outcome > 0:
            state, load_factor = found, level
            increment *= fastest if steps <= EASY else 2
            continue
        fastest = 2
        increment = (level - (load_factor or 0.0)) / 4
        if increment <= least * max(load_factor or 0.0, first):
            break
    return ContinuationResult(state, load_factor, outcome)
