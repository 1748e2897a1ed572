"""What to ask a design for, so that its print meets the targets (space mapping)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.rounding import rounded
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.miss import Aim, Residuals
from toros_fem.measures.cross_sections import Rod

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
# Least curvature, over that of an arc of 1 rad, and stretch that count as 1, and largest change of
# a strain in one round, over what counts as 1.
TURN, STRETCH, STRAIN_STEP = 1.0, 0.2, 1.0
# Weights of a strain and its neighbours: between lines the strains of a print vary.
SMOOTH = (0.25, 0.5, 0.25)


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


@dataclass(frozen=True, eq=False)
class StrainResponse:
    """Strains of cross-sections that were asked beyond the target's, and what the print has beyond.

    Attributes:
        asked, printed: Differences from the strains of the target, (k, 6), as of `Rod.strains`.
    """

    asked: Floats
    printed: Floats


def strains_beyond(rod: Rod, goal: Rod) -> Floats:
    """Return the strains of a shape minus those of the target, smoothed along it, (k, 6)."""
    off = rod.strains - goal.strains
    ends = np.concatenate([off[:1], off, off[-1:]])
    return np.asarray(SMOOTH[0] * ends[:-2] + SMOOTH[1] * off + SMOOTH[2] * ends[2:])


def strains_to_ask(goal: Rod, answers: Sequence[StrainResponse]) -> Floats:
    """Return the strains to ask for next, beyond those of the target, (k, 6), by `next_asked`."""
    length = float(np.linalg.norm(goal.rest[-1] - goal.rest[0]))
    turn = max(TURN, length * float(np.abs(goal.strains[:, :3]).max())) / length
    size = np.repeat([turn, STRETCH], 3)
    asked, printed = (
        [(s / size).ravel() for s in of]
        for of in ([a.asked for a in answers], [a.printed for a in answers])
    )
    strains = next_asked(asked, printed, np.zeros_like(asked[0]), STRAIN_STEP)
    return size * rounded(strains, RESOLUTION).reshape(-1, 6)


def with_strains(residuals: Residuals, strains: Floats) -> Case:
    """Return the case of residuals with a target that has strains (k, 6) beyond its own."""
    assert residuals.labels is not None
    goal, whole = residuals.case.goal, residuals.case.whole
    rod = residuals.rod(goal)
    other = rod.strained(rod.strains + strains)
    moved = rod.carried(residuals.labels, whole.at_vertices(goal), other)
    return replace(residuals.case, target=moved[: len(goal)])  # those of the part come first


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
