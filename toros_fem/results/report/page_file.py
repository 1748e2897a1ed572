"""The report of a run: one page with everything in it, which a browser opens offline."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

from toros_fem.base.errors import OutputError
from toros_fem.base.files import replace_file
from toros_fem.measures.figures import Figure, formatted
from toros_fem.results.report.charts import Chart, Line
from toros_fem.results.report.flat_pattern import flat_pattern
from toros_fem.results.report.run_folder import Run, read_run
from toros_fem.results.report.scene import packed_scene
from toros_fem.results.report.tables import (
    files,
    inputs,
    key_figures,
    tolerances,
    values_shown,
    warnings,
)
from toros_fem.results.report.words import label, metrics_of

NAME = "report.html"
# Columns of the history that say how the design was found, and not what it is.
SOLVER_COLUMNS = {
    "iteration", "stage", "level", "shape", "g_r", "g_t", "gradient_norm", "kkt", "change", "beta",
    "rejected", "newton_steps", "factorisations", "seconds",
}  # fmt: skip


UNMEASURED = SOLVER_COLUMNS | {"perimeter"}


def write_report(folder: str | Path) -> Path:
    """Write report.html into a run's folder and return its path (one rank).

    Everything comes from files in the folder. A run that was stopped, or is still going on, is
    shown as far as it has come.

    Args:
        folder: Folder of the run.

    Raises:
        OutputError: The folder holds no run, a file cannot be read, or the page not be written.
    """
    run = read_run(folder)
    page = _page(run)
    path = run.folder / NAME
    try:
        replace_file(path, page.encode())
    except OSError as caught:
        raise OutputError(
            f"{path} could not be written: {caught}. Free some space, or copy the run to another "
            "folder."
        ) from None
    return path


def _page(run: Run) -> str:
    scene: dict[str, Any] = {"series": {}}
    data = ""
    if run.series:
        scene, data = packed_scene(run)
        scene |= _told(run, scene["series"], scene["step"])
    told = warnings(run)
    version = (run.summary.entries.get("versions") or {}).get("toros_fem", "")
    parts = {
        "TITLE": escape(run.name),
        "NAME": escape(run.name),
        "VERSION": escape(f"toros_fem {version}".strip()),
        "STYLE": _text("report.css"),
        "WARNINGS": "".join(f"<li>{escape(text)}</li>" for text in told),
        "FIGURES": key_figures(run),
        "TOLERANCE": tolerances(run),
        "CURVE": "".join(_framed(chart) for chart in _curve(run)),
        "CONVERGENCE": "".join(_framed(chart) for chart in _convergence(run)),
        "PATTERN": flat_pattern(run.folder / "pattern.svg"),
        "INPUTS": inputs(run),
        "FILES": files(run.folder),
        "SCENE": json.dumps(scene, ensure_ascii=False).replace("<", "\\u003c"),
        "DATA": data,
        "LICENCE": _text("three.LICENSE").strip(),
        "LIBRARY": _text("three.min.js"),
        "VIEWER": _text("viewer.js"),
    }
    # In one pass, so that nothing that is filled in is taken for a place.
    return re.sub("@([A-Z]+)@", lambda place: parts[place[1]], _text("report.html"))


def _told(run: Run, series: Mapping[str, list[dict[str, Any]]], step: float) -> dict[str, Any]:
    """Add to the frames what a reader sees of them; return what the page begins with."""
    for name, entries in series.items():
        for k, entry in enumerate(entries):
            values = entry.pop("values")
            if name == "iteration":
                # Without a perimeter term there is no length of a border.
                left_out = SOLVER_COLUMNS if values.get("perimeter") else UNMEASURED
                values = {key: v for key, v in values.items() if key not in left_out}
            entry["shown"] = values_shown(values)
            entry["x"] = entry["number"]
            if name == "pressure":
                entry["x"] = values["pressure_pa"] / 1e3
                entry["label"] = f"{entry['x']:.4g} kPa"
            elif name == "iteration":
                last = run.history[-1]["iteration"] if run.history else entry["number"]
                entry["label"] = f"{entry['number']} of {last:.0f}"
            elif name == "gait":
                entry["label"] = f"position {k + 1} of {len(entries)}"
            else:
                entry["label"] = "closed on the object"
    name = next(iter(series))
    index = len(series[name]) - 1
    at = run.summary.value("pressure_pa")
    if name == "pressure" and at is not None:
        index = min(range(index + 1), key=lambda k: abs(series[name][k]["x"] - at / 1e3))
    return {
        "start": {"series": name, "index": index},
        # Series in other coordinates than those of the design are framed by themselves.
        "frame_of": {key: key if key in ("gait", "load") else "design" for key in series},
        "resolution": f"Positions to {1e6 * step:.2g} µm, stretches to 0.01, densities to 0.004.",
    }


def _text(name: str) -> str:
    folder = resources.files("toros_fem.results.report")
    return folder.joinpath("page", name).read_text(encoding="utf-8")


def _framed(chart: Chart) -> str:
    return f"<figure>{chart.svg()}</figure>"


def _curve(run: Run) -> list[Chart]:
    """Return the charts over the pressure, those with a target first."""
    rows = run.curve
    if len(rows) < 2:
        return []
    measured = (run.summary.entries.get("curve") or {}).get("measured") or []
    at = run.summary.value("pressure_pa")
    charts = []
    for metric in _by_target(metrics_of(run.summary, list(rows[0]))):
        here = [row for row in rows if metric.key in row]
        x = [row["pressure_pa"] / 1e3 for row in here]
        points = [
            (
                f"{m['source']}: {formatted(m['measured'], metric.unit)}",
                m["pressure_pa"] / 1e3,
                m["measured"],
            )
            for m in measured
            if m["metric"] == metric.key
        ]
        value, chosen = metric.value, None
        if at and value is not None and x[0] <= at / 1e3 <= x[-1]:
            chosen = ("the design's pressure", at / 1e3, value)
        charts.append(
            Chart(
                "pressure",
                "pressure (kPa)",
                label(metric),
                [Line(metric.name.replace("_", " "), x, [row[metric.key] for row in here])],
                metric.target,
                points,
                chosen,
            )
        )
    return charts


def _convergence(run: Run) -> list[Chart]:
    """Return the charts over the iterations: objective, metrics with a target, grey level."""
    rows = run.history
    if len(rows) < 2:
        return []
    x = [row["iteration"] for row in rows]
    breaks = [b["iteration"] for a, b in pairwise(rows) if a.get("level") != b.get("level")]

    def chart(label: str, lines: Sequence[Line], **further: Any) -> Chart:
        return Chart("iteration", "iteration", label, lines, breaks=breaks, **further)

    charts = [
        chart("objective T", [Line("T", x, [row["objective"] for row in rows])], logarithmic=True)
    ]
    for metric in _by_target(metrics_of(run.summary, list(rows[0]))):
        if metric.target is not None or not run.summary:
            y = [row[metric.key] for row in rows]
            charts.append(chart(label(metric), [Line(metric.name, x, y)], target=metric.target))
    lines = [
        Line(name.replace("_", " "), x, [row[name] for row in rows], look)
        for name, look in (("volume_fraction", "first"), ("grey_level", "second"))
        if name in rows[0]
    ]
    return charts + ([chart("fraction", lines)] if lines else [])


def _by_target(metrics: Sequence[Figure]) -> list[Figure]:
    return sorted(metrics, key=lambda metric: metric.target is None)
