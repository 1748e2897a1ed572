"""Words beside points of a chart, where they cover neither lines nor other words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from toros_fem.base.array_types import Floats
from toros_fem.results.pictures.style import TEXT, note

# Where words are tried, from their point: at the left above first, and further away in turn.
SIDES = ((-1, 1), (1, 1), (1, -1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0))
# Distances in points that are tried.
DISTANCES = (7.0, 12.0, 20.0, 32.0)
# Width of a letter and height of a line, over the size of the letters.
LETTER, LINE = 0.62, 1.25
# Points that each line is divided into; room around words in points.
SAMPLES, ROOM = 2000, 2.0
# Words may be so far above the axes, in points.
HIGHER = 10.0


class Word(NamedTuple):
    """Words about a point in the units of the axes; the size of letters is in points."""

    text: str
    at: tuple[float, float]
    colour: str
    size: float = TEXT
    bold: bool = False

    @property
    def extent(self) -> Floats:
        """About the width and height in points."""
        rows = self.text.split("\n")
        wide = LETTER * (1.15 if self.bold else 1.0) * max(map(len, rows))
        return self.size * np.array([wide, LINE * len(rows)])


def write_words(
    axes: Axes,
    words: Sequence[Word],
    lines: Sequence[Floats],
    distances: Sequence[float] = DISTANCES,
    sides: Sequence[tuple[int, int]] = SIDES,
    points: Floats | None = None,
) -> None:
    """Write each of some words, the most important first, where it covers least near its point.

    The limits of the axes must be those of the finished picture. Lines and further points, (n, 2)
    in the units of the axes, should not be covered. Each word is tried at some distances in points
    from its point, on each of its sides, 1 to the right or above.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    pixels = figure.dpi / 72
    axes.autoscale_view()
    placed = axes.transData.transform
    drawn = [_divided(placed(line)) / pixels for line in lines]
    covered = np.concatenate([np.zeros((0, 2)), *drawn])
    if points is not None:
        covered = np.concatenate([covered, placed(points) / pixels])
    low, high = np.array(axes.bbox.extents).reshape(2, 2) / pixels + [[0.0, 0.0], [0.0, HIGHER]]
    taken: list[tuple[Floats, Floats]] = []
    for word in words:
        at, extent = placed(word.at) / pixels, word.extent
        places = []
        for distance in distances:
            for side in np.array(sides, dtype=float):
                corner = at + distance * side * [1.0, 0.7] + extent * (side - 1) / 2
                one, other = corner - ROOM, corner + extent + ROOM
                hits = int(np.all((covered > one) & (covered < other), axis=1).sum())
                hits += SAMPLES * sum(bool(np.all((one < b) & (a < other))) for a, b in taken)
                hits += SAMPLES * bool(np.any(one < low) or np.any(other > high))
                places.append((hits, corner))
        _, corner = min(places, key=lambda place: place[0])
        taken.append((corner, corner + extent))
        weight = "bold" if word.bold else "normal"
        note(axes, word.text, word.at, corner - at, word.colour, word.size, weight=weight, zorder=6)


def _divided(line: Floats) -> Floats:
    """Return points along a line whose gaps are smaller than letters, without undefined ones."""
    line = line[np.isfinite(line).all(axis=1)]
    if len(line) < 2:
        return line
    at, before = np.linspace(0, len(line) - 1, SAMPLES), np.arange(len(line))
    return np.stack([np.interp(at, before, line[:, k]) for k in (0, 1)], axis=1)
