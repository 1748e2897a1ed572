"""Continuation: increments grow on success and shrink on failure."""

import numpy as np

from toros_fem.mechanics.equilibrium.continuation import (
    Attempt,
    ContinuationResult,
    run_continuation,
)


def continued(limit: float, *, jump: float = 1.0) -> tuple[ContinuationResult, list[float]]:
    """Continue where an attempt succeeds up to a limit, and if it jumps no further than that."""
    tried: list[float] = []

    def attempt(state: np.ndarray, level: float) -> Attempt:
        tried.append(level)
        good = level <= limit and level - state[0] <= jump
        return Attempt(np.array([level]), 2, 5) if good else Attempt(state + np.nan, -5, 5)

    begin = ContinuationResult(np.zeros(1), None, 0)
    return run_continuation(attempt, begin, 0.25, 0.05), tried


def test_it_reaches_the_top() -> None:
    end, tried = continued(10.0)
    assert (end.load_factor, end.outcome, end.state[0]) == (1.0, 2, 1.0)
    assert tried == [0.25, 1.0]


def test_increments_shrink() -> None:
    end, tried = continued(10.0, jump=0.3)
    assert end.load_factor == end.state[0] == 1.0
    assert len(tried) < 9


def test_the_last_good_level_is_kept() -> None:
    end, tried = continued(0.7)
    assert end.outcome < 0
    assert 0.7 - 0.05 <= end.load_factor <= 0.7
    assert end.state[0] == end.load_factor
    assert len(tried) < 20


def test_no_level_is_ever_reached() -> None:
    end, tried = continued(-1.0)
    assert end.load_factor is None
    assert end.state[0] == 0.0
    assert len(tried) < 5


def test_many_steps_slow_the_increments_down() -> None:
    """A level that took more than ten steps only doubles the next increment."""
    tried: list[float] = []

    def attempt(state: np.ndarray, level: float) -> Attempt:
        tried.append(level)
        return Attempt(np.array([level]), 2, 11)

    run_continuation(attempt, ContinuationResult(np.zeros(1), None, 0), 0.125, 0.05)
    assert tried == [0.125, 0.375, 0.875, 1.0]
