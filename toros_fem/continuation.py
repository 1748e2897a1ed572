"""Climbing to a load in steps that grow where they succeed and shrink where they fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

# Until a level fails, one reached in so many steps lets the next increment be four times as large.
EASY = 10


@dataclass(frozen=True, eq=False)
class Load:
    """A pressure in Pa, and dead forces in N on all assembled vertices."""

    pressure: float
    force: Floats | None

    def __bool__(self) -> bool:
        return self.pressure > 0 or self.force is not None

    def __str__(self) -> str:
        if self.force is None:
            return f"{self.pressure:g} Pa"
        total = np.linalg.norm(self.force, axis=1).sum()
        forces = f"forces of {total:.4g} N in all"
        return f"{self.pressure:g} Pa and {forces}" if self.pressure else forces

    def share(self, share: float) -> Load:
        """A share of it."""
        return Load(0.0, None).towards(self, share)

    def towards(self, other: Load, share: float) -> Load:
        """What lies between, share of the way to another."""
        pressure = self.pressure + share * (other.pressure - self.pressure)
        if self.force is None and other.force is None:
            return Load(pressure, None)
        mine, theirs = (0.0 if load.force is None else load.force for load in (self, other))
        return Load(pressure, np.asarray(mine + share * (theirs - mine)))


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
