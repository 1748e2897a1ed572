"""Line charts of a page: those of the pictures as SVG, over which the page moves a line."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import Any

from toros_fem.base.errors import MissingPackageError
from toros_fem.measures.figures import Figure
from toros_fem.results.report.tables import metrics_of
from toros_fem.results.runs.run_folder import Run

# Size in inches. The page shows charts about as large, so that letters have its size.
SIZE = (6.0, 2.6)
UNDATED = dict.fromkeys(("Creator", "Date", "Format", "Type"))
# Names of the pictures' colours in the page, which has others of its own in the dark.
COLOURS = {
    "DARK": "print", "SECOND": "second", "ACCENT": "accent", "INK": "ink", "SOFT": "soft",
    "GRID": "grid",
}  # fmt: skip


@dataclass(frozen=True)
class Chart:
    """A chart of a page.

    Attributes:
        svg: Its SVG element, which tells the page where its axis is.
        label: What it shows, in words.
    """

    svg: str
    label: str


def over_pressure(run: Run) -> list[Chart]:
    """Return a chart of each metric over the pressure, those with a target first."""
    if len(run.curve) < 2:
        return []
    curves, _ = _pictures()
    measured, broken = run.measured
    beside = [curves.Measured(**one) for one in measured]
    at, found = run.summary.value("pressure_pa"), metrics_of(run.summary, list(run.curve[0]))

    def draw(metric: Any, axes: Any) -> None:
        rows = [row for row in run.curve if metric.key in row]
        curves.draw_over_pressure(axes, rows, [metric], at, beside, broken)
        axes.set_xlabel(curves.PRESSURE)

    by_target = sorted(found, key=lambda metric: metric.target is None)
    return [chart("pressure", partial(draw, metric)) for metric in by_target]


def over_iterations(run: Run) -> list[Chart]:
    """Return a chart of the objective over the iterations, with each metric that has a target."""
    rows = run.history
    if len(rows) < 2:
        return []
    known = metrics_of(run.summary, list(rows[0]))
    shown: list[Figure | None] = [m for m in known if m.target is not None or not run.summary]
    curves, _ = _pictures()
    draw = curves.draw_history
    return [chart("iteration", partial(draw, rows=rows, told=told)) for told in shown or [None]]


def chart(series: str, draw: Callable[[Any], None]) -> Chart:
    """Return what a function draws on axes, as a chart.

    Args:
        series: Series of frames whose slider marks a place on its axis.
        draw: Draws on axes.

    Raises:
        MissingPackageError: matplotlib is not installed.
    """
    _, style = _pictures()
    stream = io.StringIO()
    with style.rc_context(style.LETTERS):
        figure = style.Figure(SIZE, layout="constrained")
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
    return Chart(svg, f"{axes.get_ylabel()} over {axes.get_xlabel()}")


def _pictures() -> tuple[ModuleType, ModuleType]:
    """Return the modules of curves and of the pictures' style, which need matplotlib."""
    try:
        import_module("matplotlib")
        from toros_fem.results.pictures import curves, style
    except ImportError as missing:
        raise MissingPackageError(f"{missing}; pip install toros_fem[plot]") from None
    return curves, style
