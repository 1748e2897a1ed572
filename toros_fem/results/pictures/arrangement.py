"""Places of states beside each other, in rows, so that they are as large as a page lets them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats

# Points: height of the name above a state, distance between the middles of two states for names not
# to meet, and distance between two states at least.
NAME_ABOVE, NAME_ACROSS, GAP = 16.0, 60.0, 10.0
# Columns are at most so many times the width of a state apart.
APART = 2.8


@dataclass(frozen=True)
class Arrangement:
    """States in rows, each moved as a whole.

    Attributes:
        scale: Points on the page per m.
        moves: How far each state is moved to the right and upwards, (n, 2), in m.
        low, high: Corners of what all need with their names, (2,), in m.
    """

    scale: float
    moves: Floats
    low: Floats
    high: Floats


def arrange(extents: Sequence[Floats], space: Floats) -> Arrangement:
    """Return the rows of states in which these are largest.

    States of a row keep their heights over each other, and those of a column their places across.

    Args:
        extents: Lower left and upper right corner of each state on the picture, (2, 2), in m.
        space: Width and height that they may take, (2,), in points.
    """
    found = [_in_columns(np.array(extents), k, space) for k in range(1, len(extents) + 1)]
    return max(found, key=lambda one: one.scale)


def _in_columns(extents: Floats, columns: int, space: Floats) -> Arrangement:
    """Return the rows of so many states each."""
    rows = [extents[k : k + columns, :, 1] for k in range(0, len(extents), columns)]
    low = np.array([row[:, 0].min() for row in rows])
    heights = np.array([row[:, 1].max() for row in rows]) - low
    left, width = extents[:, 0, 0].min(), np.ptp(extents[..., 0])
    across, up = space - [GAP * columns, (NAME_ABOVE + GAP) * len(rows) - GAP]
    # Too many columns for their names are no choice, as is a page without room.
    scale = max(min(across / (columns * width), up / heights.sum()), 1e-9)
    if columns * NAME_ACROSS > space[0]:
        scale = 1e-9
    pitch = min(max(APART * width, NAME_ACROSS / scale), space[0] / (columns * scale))
    pitch = max(pitch, width + GAP / scale)
    bottoms = GAP / scale - np.cumsum(heights + (NAME_ABOVE + GAP) / scale)
    number = np.arange(len(extents))
    moves = np.stack([number % columns * pitch, (bottoms - low)[number // columns]], axis=1)
    middle = (columns - 1) * pitch / 2 + left + width / 2
    half = max(columns * pitch, width) / 2
    corners = np.array([[middle - half, bottoms[-1]], [middle + half, 0.0]])
    return Arrangement(scale, moves, *corners)
