"""A design is asked again for what its print misses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

# What was asked, the design that answers it, and its print: whatever the caller makes of them.
A = TypeVar("A")


def correct(
    first: A,
    again: Callable[[Sequence[A]], A | None],
    enough: Callable[[Sequence[A]], bool],
    rounds: int,
) -> list[A]:
    """Return the attempts to hit a target, the first and those that correct it (collective).

    Args:
        first: The first attempt.
        again: Returns the next attempt, from all before it; None where no more can be asked.
        enough: Whether these attempts are enough.
        rounds: Largest number of corrections.
    """
    attempts = [first]
    while len(attempts) <= rounds and not enough(attempts):
        attempt = again(attempts)
        if attempt is None:
            break
        attempts.append(attempt)
    return attempts
