"""What to ask a design for, so that its print meets the targets (space mapping)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.rounding import rounded
from toros_fem.measures.metrics import Metric

# A print is good enough where every metric is this close to its target, over its scale.
CLOSE = 5e-3
# Below this error lines stay where they are: what is left is of the size of the mesh's error, and
# of that by which prints of like designs differ.
FINE = 5e-2
# A correction helps that leaves at most this part of the worst error.
HELPS = 0.7
# What is asked is rounded to this part of its metric's scale.
RESOLUTION = 1e-5
# Bounds on the change of a printed metric over that of the one asked.
LEAST_SLOPE, LARGEST_SLOPE = 0.4, 3.0
# Largest change of what is asked in one round, over the scale of its metric.
LARGEST_STEP = 0.4


class Aim(NamedTuple):
    """Target of a metric, and the distance from it that counts as 1."""

    target: float
    scale: float


def aims_of(metrics: Sequence[Metric]) -> dict[str, Aim]:
    """Return the aims of all metrics that have a target, by key."""
    return {
        m.key: Aim(m.target, m.scale or abs(m.target) or 1.0)
        for m in metrics
        if m.target is not None
    }


def asked_next(
    got: Sequence[Mapping[str, float]],
    asked: Sequence[Mapping[str, float]],
    aims: Mapping[str, Aim],
) -> dict[str, float]:
    """Return which targets to ask for next, by `next_asked`.

    Args:
        got, asked: Metrics of all rounds, the last one last, and what was asked of them, by key.
        aims: The metrics that count.
    """
    size = np.array([aim.scale for aim in aims.values()])

    def vector(values: Mapping[str, float]) -> Floats:
        return np.array([values[key] for key in aims]) / size

    target = vector({key: aim.target for key, aim in aims.items()})
    found = next_asked([*map(vector, asked)], [*map(vector, got)], target, LARGEST_STEP)
    return dict(zip(aims, map(float, size * rounded(found, RESOLUTION)), strict=True))


def next_asked(
    asked: Sequence[Floats], printed: Sequence[Floats], target: Floats, largest: float
) -> Floats:
    """Return what to ask for next: Broyden's step, whose first matrix is the identity.

    Broyden's matrix, the change of printed by that of asked numbers, also knows what one of them
    does to another.

    Args:
        asked, printed: Numbers of each round, (j,).
        target: What shall be printed.
        largest: Largest change of a number.
    """
    slope: Floats = np.eye(len(target))
    for k in range(1, len(asked)):
        step, change = asked[k] - asked[k - 1], printed[k] - printed[k - 1]
        if step @ step > 0:
            slope += np.outer(change - slope @ step, step) / (step @ step)
    left, value, right = np.linalg.svd(slope)
    value = np.clip(value, LEAST_SLOPE, LARGEST_SLOPE)
    step = right.T @ (left.T @ (target - printed[-1]) / value)
    return np.asarray(asked[-1] + np.clip(step, -largest, largest))
