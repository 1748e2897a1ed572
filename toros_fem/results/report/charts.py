"""Line charts of a page: matplotlib's figures as SVG, over which the page moves a line."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from toros_fem.base.errors import MissingPackageError

# Size in inches. The page shows charts about as large, so that letters have its size.
SIZE = (6.0, 2.6)
# Colours, and their names in the page's style, which has others of its own in the dark.
COLOURS = {
    "#1f3a5f": "print", "#0072b2": "second", "#d55e00": "accent", "#222222": "ink",
    "#6b7280": "soft", "#e5e7eb": "grid",
}  # fmt: skip
PRINT, SECOND, ACCENT, INK, SOFT, GRID = COLOURS
STYLE = {
    "svg.fonttype": "none", "svg.hashsalt": "toros_fem", "font.family": "DejaVu Sans",
    "font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False,
    "axes.edgecolor": SOFT, "axes.labelcolor": INK, "xtick.color": SOFT, "ytick.color": SOFT,
    "axes.axisbelow": True, "axes.grid": True, "axes.grid.axis": "y", "grid.color": GRID,
    "text.parse_math": False,
}  # fmt: skip
UNDATED = dict.fromkeys(("Creator", "Date", "Format", "Type"))


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a chart: its name and its points."""

    label: str
    x: Sequence[float]
    y: Sequence[float]


@dataclass(frozen=True, eq=False)
class Chart:
    """A chart over one axis.

    Attributes:
        series: Series of frames whose slider marks a place on its axis.
        x_label, y_label: Names of its axes, with units.
        lines: Its lines, two at most.
        target: A value to reach, a dashed line with its text; None for none.
        points: Values of others, measured for instance: name, x and y.
        chosen: The place that the run's figures are of: name, x and y; None for none.
        logarithmic: Whether its y axis is logarithmic.
        breaks: Places from which the mesh is finer, dotted lines.
    """

    series: str
    x_label: str
    y_label: str
    lines: Sequence[Line]
    target: tuple[float, str] | None = None
    points: Sequence[tuple[str, float, float]] = ()
    chosen: tuple[str, float, float] | None = None
    logarithmic: bool = False
    breaks: Sequence[float] = ()

    def svg(self) -> str:
        """Return the chart as an SVG element; the page finds its axis in its attributes.

        Raises:
            MissingPackageError: matplotlib is not installed.
        """
        try:
            import matplotlib
            from matplotlib.figure import Figure
        except ImportError as missing:
            raise MissingPackageError(f"{missing}; pip install toros_fem[plot]") from None
        stream = io.StringIO()
        with matplotlib.rc_context(STYLE):
            figure = Figure(SIZE, layout="constrained")
            axes = figure.subplots()
            self._draw(axes)
            figure.savefig(stream, format="svg", metadata=UNDATED, transparent=True)
        wide, deep = (72 * length for length in SIZE)
        box = axes.get_position()
        low, high = (float(x) for x in axes.get_xlim())
        # Ids of matplotlib's parts would stand several times in a page; those that begin with "m"
        # and "p" and a number of hexadecimal digits are of their content, and referred to.
        drawn = re.sub(r' id="[\w.]+_\d+"', "", stream.getvalue().partition("<g")[2])
        drawn = drawn.replace("xlink:href", "href").removesuffix("</svg>\n")
        for colour, name in COLOURS.items():
            drawn = drawn.replace(colour, f"var(--{name})")
        return (
            f'<svg class="chart" viewBox="0 0 {wide:g} {deep:g}" data-series="{self.series}" '
            f'data-low="{low!r}" data-high="{high!r}" data-left="{wide * box.x0:.2f}" '
            f'data-right="{wide * box.x1:.2f}"><g{drawn}<line class="now" x1="-9" x2="-9" '
            f'y1="{deep * (1 - box.y1):.2f}" y2="{deep * (1 - box.y0):.2f}"/></svg>'
        )

    def _draw(self, axes: Any) -> None:
        axes.set(xlabel=self.x_label, ylabel=self.y_label)
        axes.margins(x=0)
        positive = [y for line in self.lines for y in line.y if y > 0]
        if self.logarithmic and positive:
            least, most = (math.log10(y) for y in (min(positive), max(positive)))
            ends = 10.0 ** math.floor(least), 10.0 ** max(math.ceil(most), math.floor(least) + 1)
            axes.set(yscale="log", ylim=ends)
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("")
        for x in self.breaks:
            axes.axvline(x, color=SOFT, linestyle=":", linewidth=1)
            _write(axes, "finer mesh", x, 1, SOFT, xycoords=("data", "axes fraction"))
        for line, colour in zip(self.lines, (PRINT, SECOND), strict=False):
            few = "o" if len(line.x) < 40 else None
            axes.plot(line.x, line.y, color=colour, marker=few, markersize=3.5, linewidth=1.5)
            if len(self.lines) > 1:
                _write(axes, line.label, line.x[-1], line.y[-1], colour)
        if self.target is not None:
            value, text = self.target
            axes.axhline(value, color=ACCENT, linestyle="--", linewidth=1)
            _write(axes, text, 1, value, ACCENT, xycoords=("axes fraction", "data"))
        for name, x, y in self.points:
            axes.plot(x, y, "D", color=INK, markerfacecolor="none", markersize=6)
            _write(axes, name, x, y, INK)
        if self.chosen is not None:
            name, x, y = self.chosen
            axes.plot(x, y, "o", color=ACCENT, markersize=7, clip_on=False)
            rises = self.lines[0].y[-1] > self.lines[0].y[0]  # the text stands beside the line
            _write(axes, name, x, y, ACCENT, up=-13.0 if rises else 11.0)


def _write(axes: Any, text: str, x: float, y: float, colour: str, **place: Any) -> None:
    """Write a text to the right of a point."""
    up = place.pop("up", 0.0)
    axes.annotate(
        text, (x, y), (6.0, up), textcoords="offset points", color=colour, va="center",
        annotation_clip=False, **place,
    )  # fmt: skip
