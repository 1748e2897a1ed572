"""The shape that a relaxed design is asked for, so that its print takes the target's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.rounding import rounded
from toros_fem.design.loop.case import Case
from toros_fem.products.actuators.misses import misses_of
from toros_fem.products.actuators.space_mapping import RESOLUTION, next_asked

# Least curvature, over that of an arc of 1 rad, and stretch that count as 1.
TURN, STRETCH = 1.0, 0.2
# Largest change of a strain in one round, over what counts as 1.
LARGEST_STEP = 1.0
# Weights of a strain and its neighbours: between lines the strains of a print vary.
SMOOTH = (0.25, 0.5, 0.25)


@dataclass(frozen=True, eq=False)
class Answer:
    """Strains of cross-sections that were asked beyond the target's, and what the print has beyond.

    Attributes:
        asked, printed: Differences from the strains of the target, (k, 6), as of `Rod.strains`.
    """

    asked: Floats
    printed: Floats


def strains_beyond(case: Case, positions: Floats) -> Floats:
    """Return the strains of a shape minus those of the target, (k, 6), smoothed along the body.

    The shape is that of all vertices of the case, (n, 3), in m.
    """
    misses = misses_of(case)
    off = misses.rod(positions).strains - misses.rod(case.goal).strains
    ends = np.concatenate([off[:1], off, off[-1:]])
    return np.asarray(SMOOTH[0] * ends[:-2] + SMOOTH[1] * off + SMOOTH[2] * ends[2:])


def strains_to_ask(case: Case, answers: Sequence[Answer]) -> Floats:
    """Return the strains to ask for next, beyond those of the target, (k, 6)."""
    goal = misses_of(case).rod(case.goal)
    length = float(np.linalg.norm(goal.rest[-1] - goal.rest[0]))
    turn = max(TURN, length * float(np.abs(goal.strains[:, :3]).max())) / length
    size = np.repeat([turn, STRETCH], 3)
    asked, printed = (
        [(s / size).ravel() for s in of]
        for of in ([a.asked for a in answers], [a.printed for a in answers])
    )
    found = next_asked(asked, printed, np.zeros_like(asked[0]), LARGEST_STEP)
    return size * rounded(found, RESOLUTION).reshape(-1, 6)


def asking(case: Case, strains: Floats) -> Case:
    """Return a case whose target has strains (k, 6) beyond those of its own target."""
    misses, goal, whole = misses_of(case), case.goal, case.whole
    assert misses.labels is not None
    rod = misses.rod(goal)
    other = rod.strained(rod.strains + strains)
    places = goal if whole is None else whole.at_vertices(goal)
    moved = rod.carried(misses.labels, places, other)
    return replace(case, target=moved[: len(goal)])  # those of the part come first
