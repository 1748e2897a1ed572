"""Words beside points of a chart, where they cover neither lines nor other words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.font_manager import FontProperties
from matplotlib.text import Annotation, Text

from toros_fem.base.array_types import Floats
from toros_fem.results.pictures.style import DPI, TEXT, note

# Where words are tried, from their point: at the left above first, and further away in turn.
SIDES: tuple[tuple[float, float], ...] = (
    (-1, 1), (1, 1), (1, -1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0),
)  # fmt: skip
# Distances in points that are tried.
DISTANCES = (7.0, 12.0, 20.0, 32.0)
# Height of a line, over the size of the letters.
LINE = 1.25
# Points that each line is divided into; room around words in points.
SAMPLES, ROOM = 2000, 2.0
# Words may be so far above the axes, in points.
HIGHER = 10.0
# Words that are further than this from their point, in points, have a line to it.
FAR = 24.0


class Word(NamedTuple):
    """Words about a point in the units of the axes; the size of letters is in points.

    They are tried on these sides of their point, 1 to the right or above, the first ones first.
    """

    text: str
    at: tuple[float, float]
    colour: str
    size: float = TEXT
    bold: bool = False
    sides: Sequence[tuple[float, float]] = SIDES

    @property
    def extent(self) -> Floats:
        """Width and height in points."""
        rows = self.text.split("\n")
        font = FontProperties(size=self.size, weight="bold" if self.bold else "normal")
        sizes = RendererAgg(1, 1, DPI).get_text_width_height_descent
        wide = max(sizes(row, font, False)[0] for row in rows)
        return np.array([72 / DPI * wide, LINE * self.size * len(rows)])


def write_words(
    axes: Axes,
    words: Sequence[Word],
    lines: Sequence[Floats],
    distances: Sequence[float] = DISTANCES,
    points: Floats | None = None,
) -> None:
    """Write each of some words, the most important first, where it covers least near its point.

    The limits of the axes must be those of the finished picture. Lines, further points, (n, 2) in
    the units of the axes, and what is written already should not be covered. Each word is tried at
    some distances in points from its point; one that ends far from it has a thin line to it.
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
    renderer = FigureCanvasAgg(figure).get_renderer()
    taken = [_box(text, renderer) / pixels for text in axes.texts if text.get_text()]
    for word in words:
        at, extent = placed(word.at) / pixels, word.extent
        places = []
        for distance in distances:
            for side in np.array(word.sides, dtype=float):
                corner = at + distance * side * [1.0, 0.7] + extent * (side - 1) / 2
                one, other = corner - ROOM, corner + extent + ROOM
                hits = int(np.all((covered > one) & (covered < other), axis=1).sum())
                hits += SAMPLES * sum(bool(np.all((one < b) & (a < other))) for a, b in taken)
                hits += SAMPLES * bool(np.any(one < low) or np.any(other > high))
                places.append((hits, corner))
        _, corner = min(places, key=lambda place: place[0])
        taken.append(np.array([corner, corner + extent]))
        look: dict[str, Any] = {"weight": "bold" if word.bold else "normal", "zorder": 6}
        near = np.clip(at, corner, corner + extent)
        if np.hypot(*(near - at)) > FAR:
            anchor = tuple((near - corner) / extent)
            look["arrowprops"] = {
                "arrowstyle": "-", "color": word.colour, "lw": 0.6, "shrinkA": 1, "shrinkB": 1,
                "relpos": anchor,
            }  # fmt: skip
        note(axes, word.text, word.at, corner - at, word.colour, word.size, **look)


def _box(text: Text, renderer: RendererAgg) -> Floats:
    """Return the corners of words in pixels, without the arrows of annotations."""
    if isinstance(text, Annotation):
        text.update_positions(renderer)
    return np.asarray(Text.get_window_extent(text, renderer).get_points())


def _divided(line: Floats) -> Floats:
    """Return points along a line whose gaps are smaller than letters, without undefined ones."""
    line = line[np.isfinite(line).all(axis=1)]
    if len(line) < 2:
        return line
    at, before = np.linspace(0, len(line) - 1, SAMPLES), np.arange(len(line))
    return np.stack([np.interp(at, before, line[:, k]) for k in (0, 1)], axis=1)
