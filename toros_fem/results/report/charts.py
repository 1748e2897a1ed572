"""Line charts of a page: those of the pictures as SVG, over which the page moves a line."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from toros_fem.measures.figures import Figure
from toros_fem.results.pictures import style
from toros_fem.results.pictures.curves import (
    draw_history,
    draw_over_pressure,
    pressure_label,
)
from toros_fem.results.report.tables import metrics_of
from toros_fem.results.runs.stored_run import Run

# Size in inches. The page shows charts about as large, so that letters have its size.
SIZE = (6.0, 2.6)
UNDATED = dict.fromkeys(("Creator", "Date", "Format", "Type"))
# Names of the pictures' colours in the page, which has others of its own in the dark.
COLOURS = {
    "DARK": "print", "SECOND": "second", "ACCENT": "accent", "INK": "ink", "SOFT": "soft",
    "GRID": "grid",
}  # fmt: skip


Chart = tuple[str, str]
"""A chart of a page: its SVG element, which tells where its axis is, and words on it."""


def over_pressure(run: Run) -> list[Chart]:
    """Return a chart of each metric over the pressure, those with a target first."""
    if len(run.curve) < 2:
        return []
    whole = run.over_pressure(run.summary.value("pressure_pa"))
    known = {key for row in whole.rows for key in row}
    found = metrics_of(run.summary, [key for key in run.curve[0] if key in known])

    def draw(metric: Figure, axes: Axes) -> None:
        rows = [row for row in whole.rows if metric.key in row]
        draw_over_pressure(axes, replace(whole, rows=rows), [metric])
        axes.set_xlabel(pressure_label(whole))

    by_target = sorted(found, key=lambda metric: metric.target is None)
    return [chart("pressure", partial(draw, metric)) for metric in by_target]


def over_iterations(run: Run) -> list[Chart]:
    """Return a chart of the objective over the iterations, with each metric that has a target."""
    rows = run.history
    if len(rows) < 2:
        return []
    known = metrics_of(run.summary, list(rows[0]))
    shown: list[Figure | None] = [m for m in known if m.target is not None or not run.summary]
    draws = [partial(draw_history, rows=rows, told=told) for told in shown or [None]]
    return [chart("iteration", draw) for draw in draws]


def chart(series: str, draw: Callable[[Axes], None]) -> Chart:
    """Return what a function draws on axes as a chart, over which the slider of a series moves."""
    stream = io.StringIO()
    with rc_context(style.LETTERS):
        figure = Canvas(SIZE, layout="constrained")
        axes = figure.subplots()
        axes.margins(x=0)
        draw(axes)
        figure.savefig(stream, format="svg", metadata=UNDATED, transparent=True)
    wide, deep = (72 * length for length in SIZE)
    box = axes.get_position()
    low, high = (float(x) for x in axes.get_xlim())
    # Ids of matplotlib's parts would stand several times in a page; those that begin with "m" and
    # "p" and a number of hexadecimal digits are of their content, and referred to.
    drawn = re.sub(r' id="[\w.]+_\d+"', "", stream.getvalue().partition("<g")[2])
    drawn = drawn.replace("xlink:href", "href").removesuffix("</svg>\n")
    for colour, name in COLOURS.items():
        drawn = drawn.replace(getattr(style, colour).lower(), f"var(--{name})")
    svg = (
        f'<svg class="chart" viewBox="0 0 {wide:g} {deep:g}" data-series="{series}" '
        f'data-low="{low!r}" data-high="{high!r}" data-left="{wide * box.x0:.2f}" '
        f'data-right="{wide * box.x1:.2f}"><g{drawn}<line class="now" x1="-9" x2="-9" '
        f'y1="{deep * (1 - box.y1):.2f}" y2="{deep * (1 - box.y0):.2f}"/></svg>'
    )
    return svg, f"{axes.get_ylabel()} over {axes.get_xlabel()}"
