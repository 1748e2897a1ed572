"""The look of all pictures: size, colours, letters and words, and how a picture is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.collections import PathCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path as Outline
from matplotlib.text import Annotation, Text
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike
from shapely import get_coordinates, get_parts, get_rings
from shapely.geometry.base import BaseGeometry

from toros_fem.base.files import replace_file
from toros_fem.base.validation import Floats

# Left, bottom, width and height of a part of a page, over the page.
Box = tuple[float, float, float, float]
# Colour of the print in words and lines.
DARK = "#1F3A5F"
# For the target and whatever is to be looked at, and for a second line.
ACCENT, SECOND = "#D55E00", "#0072B2"
# Of curves beside each other, told apart also by those who see few colours (Okabe & Ito 2008).
SERIES = (DARK, ACCENT, SECOND, "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
INK, SOFT, GRID = "#222222", "#6B7280", "#E5E7EB"
# Of the ground, and of the edge of fabric.
GROUND, EDGE = "#F1F2F4", "#8A7D63"
SEQUENTIAL = "cividis"
SIGNED = LinearSegmentedColormap.from_list("signed", [SECOND, "white", ACCENT])
# Width and height in inches, and pixels per inch.
SIZE, TALL, STRIP, DPI = (8.0, 4.5), (8.0, 6.0), (8.0, 3.1), 200
# Room for a bar of the scale, in points.
BAR_ROOM = 30.0
# Space between a title and the border of its page, and a line of it, in inches.
BORDER, LINE = 0.12, 0.2
# Least space between numbers below charts, in points.
APART = 4.0
# Sizes of letters in points.
TEXT, TITLE, LARGE = 9.0, 11.0, 20.0
LETTERS = {
    "font.family": "DejaVu Sans",
    "font.size": TEXT,
    "axes.titlesize": TEXT,
    "axes.labelsize": TEXT,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": False,
    "axes.axisbelow": True,
    # Names of users may hold dollars; equal charts have equal bytes.
    "text.parse_math": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "toros_fem",
    "grid.color": GRID,
    "figure.facecolor": "white",
}
# Where words are tried, from their point: at the left above first, and further away in turn.
SIDES: tuple[tuple[float, float], ...] = (
    (-1, 1), (1, 1), (1, -1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0),
)  # fmt: skip
# Distances in points that are tried.
DISTANCES = (7.0, 12.0, 20.0, 32.0)
# Height of a line, over the size of the letters.
SPACING = 1.25
# Points that each line is divided into; room around words in points.
SAMPLES, ROOM = 2000, 2.0
# Words may be so far above the axes, in points.
HIGHER = 10.0
# Words that are further than this from their point, in points, have a line to it.
FAR = 24.0


def _rgb(colour: str) -> Floats:
    return np.array(to_rgb(colour))


FABRIC, PRINT, BODY = _rgb("#EBDFC8"), _rgb(DARK), _rgb("#9AA5B1")
SILHOUETTE = _rgb("#3A3326")


def write_title(figure: Figure, sentence: str) -> None:
    """Write a sentence with the result at the top of a page, on several lines if it is long."""
    width, height = figure.get_size_inches()
    lines = title_lines(sentence, width)
    top = 1 - BORDER / height
    figure.text(0.02, top, lines, fontsize=TITLE, fontweight="bold", va="top")


def title_lines(sentence: str, width: float) -> str:
    """Return a sentence in lines that fit as a title on a page of a width in inches."""
    # Letters are a little narrower or wider where a picture has fewer pixels.
    sheet = Figure(figsize=(width, 1.0), dpi=DPI)
    title = sheet.text(0, 0, "", fontsize=TITLE, fontweight="bold", parse_math=False)
    renderer = FigureCanvasAgg(sheet).get_renderer()
    lines = [""]
    for word in sentence.split():
        longer = f"{lines[-1]} {word}".strip()
        title.set_text(longer)
        fits = title.get_window_extent(renderer).width <= 0.96 * sheet.bbox.width
        lines = [*lines[:-1], longer] if fits or not lines[-1] else [*lines, word]
    return "\n".join(lines)


@contextmanager
def page(
    path: Path,
    title: str = "",
    size: tuple[float, float] = SIZE,
    facts: Mapping[str, str] | None = None,
) -> Iterator[Figure]:
    """Give a figure in the project's style, and write it as a PNG when it is drawn.

    The title is a sentence with the result, the size in inches. The facts are what the file tells
    of itself, as text chunks: run, seed, figure.

    Raises:
        OSError: It cannot be written; what was there before stays.
    """
    with rc_context(LETTERS):
        figure = Figure(figsize=size)
        if title:
            write_title(figure, title)
        yield figure
        stream = BytesIO()
        figure.savefig(stream, format="png", dpi=DPI, metadata={"Software": None, **(facts or {})})
        replace_file(path, stream.getvalue())


def fill(
    axes: Axes, shape: BaseGeometry, colour: Floats | str, edge: str = "none", width: float = 0.8
) -> None:
    """Fill a region given in m on axes in mm; the width of its border is in points."""
    rings = [1e3 * get_coordinates(ring) for ring in get_rings(get_parts(shape))]
    if rings:
        path = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
        axes.add_collection(
            PathCollection([path], facecolors=[colour], edgecolors=edge, linewidths=width)
        )


def note(
    axes: Axes,
    words: str,
    at: ArrayLike,
    offset: ArrayLike,
    colour: Any = SOFT,
    size: float = 8.0,
    **look: Any,
) -> Annotation:
    """Write words at an offset in points from a point of axes; `look` is as of `Axes.annotate`."""
    (x, y), (right, up) = np.asarray(at), np.asarray(offset)
    return axes.annotate(
        words, (x, y), (right, up), textcoords="offset points", color=colour, fontsize=size, **look
    )


def space_numbers(figure: Figure, row: Iterable[Axes], most: int) -> None:
    """Take so few numbers below charts that are beside each other that none meet, and so many."""
    charts = list(row)
    for count in range(most, 0, -1):
        for axes in charts:
            few = MaxNLocator(count, steps=(1, 2, 5, 10), min_n_ticks=1)
            axes.xaxis.set_major_locator(few)
        figure.draw_without_rendering()
        ends = sorted(
            (box.x0, box.x1)
            for axes in charts
            for box in (text.get_window_extent() for text in axes.get_xticklabels())
            if axes.bbox.x0 - 1 <= (box.x0 + box.x1) / 2 <= axes.bbox.x1 + 1
        )
        apart = APART / 72 * figure.dpi
        if all(before[1] + apart <= after[0] for before, after in pairwise(ends)):
            return


def scale_bar(axes: Axes, length: float, at: tuple[float, float]) -> None:
    """Draw a bar of a length in mm on axes in mm, and write its length.

    Its left end is given in fractions of the axes, which it may be outside of.
    """
    left, right = axes.get_xlim()
    start = left + at[0] * (right - left)
    low, high = axes.get_ylim()
    height = low + at[1] * (high - low)
    ends, look = [start, start + length], {"solid_capstyle": "butt", "clip_on": False}
    axes.plot(ends, [height] * 2, color=INK, lw=2, scalex=False, scaley=False, **look)
    note(axes, f"{length:g} mm", (start, height), (0, 4), INK, annotation_clip=False)


def bar_below(axes: Axes) -> None:
    """Draw a bar of the scale below what axes in mm show."""
    low, high = axes.get_ylim()
    figure = axes.get_figure(root=True)
    assert figure is not None
    points = 72 * figure.get_figheight() * axes.get_position().height
    axes.set_ylim(low - max(0.12, BAR_ROOM / points) * (high - low), high)
    scale_bar(axes, bar_length(float(np.ptp(axes.get_xlim()))), (0.03, 0.02))


def bar_length(span: float) -> float:
    """Return the length in mm of a bar beside something that is `span` mm large: 1, 2 or 5·10ⁿ."""
    wanted = 0.15 * span
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted * 1.0001))


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
        return np.array([72 / DPI * wide, SPACING * self.size * len(rows)])


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
