"""Climbing to a load in steps that grow where they succeed and shrink where they fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from toros_fem._types import Floats

# Until a level fails, one reached in so many steps lets the next increment be four times as large.
EASY = 10


@dataclass(frozen=True, eq=False)
class Climb:
    """How far a climb came.

    Attributes:
        state: The last equilibrium, or the start if there is none.
        reached: Its level; None if none was found.
        outcome: How the last attempt ended, a converged reason of SNES.
    """

    state: Floats
    reached: float | None
    outcome: int


def climb(
    attempt: Callable[[Floats, float], tuple[Floats, int, int]],
    start: Climb,
    top: float,
    increment: float,
    least: float,
) -> Climb:
    """Raise a level to the top.

    Args:
        attempt: Solves at a level from a state: the state found, how it ended (above 0 means an
            equilibrium), and the steps taken.
        start: Where to begin.
        top: The level wanted.
        increment: The first one.
        least: Smallest increment, over the level reached or the first increment if that is more.
    """
    state, reached, outcome = start.state, start.reached, start.outcome
    first, fastest = increment, 4
    while reached is None or reached < top:
        level = min(top, (reached or 0.0) + increment)
        found, outcome, steps = attempt(state, level)
        if outcome > 0:
            state, reached = found, level
            increment *= fastest if steps <= EASY else 2
            continue
        fastest = 2
        increment = (level - (reached or 0.0)) / 4
        if increment <= least * max(reached or 0.0, first):
            break
    return Climb(state, reached, outcome)
