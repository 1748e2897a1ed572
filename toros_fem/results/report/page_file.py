"""The report of a run: one page with everything in it, which a browser opens offline."""

from __future__ import annotations

import base64
import hashlib
import io
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from toros_fem.base.errors import OutputError
from toros_fem.base.files import naming, replace_file
from toros_fem.base.packages import required, template
from toros_fem.measures.figures import Figure
from toros_fem.results.pictures import style
from toros_fem.results.pictures.curves import (
    draw_history,
    draw_over_pressure,
    pressure_label,
)
from toros_fem.results.report import tables
from toros_fem.results.report.scene import packed_scene
from toros_fem.results.report.tables import metrics_of
from toros_fem.results.runs.files import FILES
from toros_fem.results.runs.run_folder import Run, read_run

NAME = "report.html"


def write_report(folder: str | Path) -> Path:
    """Write report.html into a run's folder and return its path (one rank).

    Everything comes from files in the folder. A run that was stopped, or is still going on, is
    shown as far as it has come.

    Raises:
        FileError: The folder holds no run.
        OutputError: A file cannot be read, or the page not be written.
        MissingPackageError: A package of the extra `plot` is not installed.
    """
    run = read_run(folder)
    page, path = page_of(run), run.folder / NAME
    with naming(path):
        replace_file(path, page.encode())
    return path


def page_of(run: Run, *, alone: bool = False) -> str:
    """Return the page of a run, or its view in space alone, as HTML that needs no other file.

    Raises:
        OutputError: A file of the run holds a value that no run writes.
        MissingPackageError: A package of the extra `plot` is not installed.
    """
    try:
        return _page(run, alone=alone)
    except (AttributeError, LookupError, TypeError, ValueError) as caught:
        raise OutputError(
            f"{run.folder}: a file, most likely summary.json, holds a value that no run writes "
            f"({caught!r}). Run the scene again."
        ) from caught


def _page(run: Run, *, alone: bool) -> str:
    filled = template("toros_fem.results.report", "page/report.html", "plot").render
    required("matplotlib", "plot")

    scene, data, patterns = packed_scene(run) if run.series else ({"series": {}}, "", [])
    # The page's own scripts run, and no other that a name or a message brings along.
    scripts = [f"\n/*\n{_text('three.LICENSE')}*/\n{_text('three.min.js')}", _text("viewer.js")]
    shown: str = filled(
        run=run,
        alone=alone,
        tables=tables,
        style=_text("report.css"),
        curve=over_pressure(run),
        convergence=over_iterations(run),
        patterns=patterns,
        files={n: text for n, text in FILES.items() if n != NAME and (run.folder / n).is_file()},
        scene=scene,
        data=data,
        scripts=scripts,
        hashes=[base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts],
    )
    return shown


def _text(name: str) -> str:
    folder = resources.files("toros_fem.results.report")
    return folder.joinpath("page", name).read_text(encoding="utf-8")


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
