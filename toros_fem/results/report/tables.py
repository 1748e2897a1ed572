"""Key figures, warnings, inputs and files of a run, as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from toros_fem.measures.figures import NONE, formatted
from toros_fem.results.report.run_folder import Run
from toros_fem.results.report.words import as_shown, label, metrics_of

# What the files of a run hold, in the order of the list.
FILES = {
    "summary.json": "all figures and inputs",
    "pattern.svg": "flat pattern, true to scale, for printer and cutter",
    "manufacture/make_it.html": "machine files of every sheet, and how to make the skin",
    "print.npz": "pattern and print, for another simulation",
    "skin.vtu": "shape and densities, for ParaView",
    "history.csv": "every step of the design",
    "curve.csv": "metrics over the pressure",
    "gait.csv": "metrics and feet over a cycle",
    "tolerance.csv": "metrics of skins that are not made as drawn",
    "inflation.gif": "inflation of the print",
    "shape.png": "inflated skin beside its target",
    "pattern.png": "flat pattern",
    "design.png": "start, density and print",
    "manufacture.png": "islands, narrow lines and gaps",
    "lines.png": "line families",
    "wrinkles.png": "wrinkles",
    "convergence.png": "objective over the iterations",
    "curve.png": "metrics over the pressure",
    "shapes.png": "shapes over the pressure",
    "gait.png": "shapes over a cycle",
    "tracks.png": "paths of the feet",
    "tolerance.png": "what moves each metric",
    "lift.png": "initial design and print lift the object",
    "finger.png": "one finger and the object",
}
# Endings and verbs after a number.
ONE = {"s": "", "hang": "hangs", "are": "is"}
MANY = {"s": "s", "hang": "hang", "are": "are"}


def key_figures(run: Run) -> str:
    """Return the table of metrics with error estimates and targets, and the figures beside it."""
    entries = run.summary.entries
    columns = [*dict.fromkeys([*_columns(run.history), *_columns(run.curve)])]
    # Where a relaxed design is laid as lines, no design by densities stands beside the print.
    laid = "lines" in entries and not entries.get("densities_kept")
    rows = []
    for figure in metrics_of(run.summary, columns):
        designed = (entries.get("design") or {}).get(figure.key)
        if not run.summary and run.history:
            designed = run.history[-1].get(figure.key)
        width, unit = figure.interval, figure.unit
        cells = [
            formatted(figure.value, unit),
            NONE if width is None else f"± {formatted(float(f'{width:.2g}'), unit)}",
            formatted(figure.target, unit),
            formatted(None if laid else designed, unit),
            "" if figure.reached is None else ("yes" if figure.reached else "no"),
        ]
        rows.append([figure.name.replace("_", " "), *cells])
    head = ["", "as printed", "interval", "target", "as designed", "reached"]
    if run.summary and "design" not in entries:
        head[1] = "value"  # of a simulation
    kept = [k for k in range(6) if k == 0 or any(row[k] not in (NONE, "") for row in rows)]
    table = _table([[row[k] for k in kept] for row in rows], [head[k] for k in kept])
    table = table if rows else ""
    return table + _pairs(_further(run))


def _further(run: Run) -> list[tuple[str, str]]:
    summary, found = run.summary.entries, list[tuple[str, str]]()
    made = summary.get("manufacture") or {}
    for key in ("pressure_pa", "volume_m3"):
        value = run.summary.value(key)
        if value is not None:
            found.append(as_shown(key, value))
    use = run.summary.value("stretch_use")
    if use is not None:
        found.append(("of the stretch bounds", f"{use:.0%} used"))
    first, last = summary.get("objective_first"), summary.get("objective_last")
    if _is_number(first) and _is_number(last):
        found.append(("objective T", f"{first:.3g} → {last:.3g}"))
    for key, name in (
        ("smallest_width_mm", "narrowest line"),
        ("smallest_gap_mm", "narrowest gap"),
    ):
        if _is_number(made.get(key)):
            found.append((name, f"{made[key]:.3g} mm"))
    if _is_number(made.get("pieces")):
        islands = f"{made['islands']} island{'s' * (made['islands'] != 1)}"
        found.append(("printed pieces", f"{made['pieces']}, of these {islands}"))
    if _is_number(summary.get("triangles")):
        parts = summary.get("parts_by_symmetry", 1)
        count = summary["triangles"]
        found.append(("triangles", f"{parts} equal parts of {count}" if parts > 1 else f"{count}"))
    if run.history:
        found.append(("iterations", f"{run.history[-1]['iteration']:.0f}"))
    seconds = (summary.get("seconds") or {}).get("total")
    if _is_number(seconds):
        ranks = summary.get("ranks", 1)
        on = "" if ranks == 1 else f" on {ranks} ranks"
        found.append(("computing time", f"{seconds:.0f} s{on}"))
    return found


def tolerances(run: Run) -> str:
    """Return the table of skins that are not made as drawn, after the worst; "" if none is there.

    Changes are as simulated, and to first order in brackets.
    """
    variants = run.tolerance.get("variants") or []
    metrics = metrics_of(run.summary, list(run.tolerance.get("nominal") or {}))
    if not variants or not metrics:
        return ""
    worst = [entry["sentence"] for entry in (run.tolerance.get("worst") or {}).values()]
    told = "".join(f"<p>{escape(text)}</p>" for text in dict.fromkeys(worst))
    rows = [
        [
            f"{row['quantity']} {row['change']}",
            *(
                f"{_signed(row[f'{m.key}_change'])} [{_signed(row[f'{m.key}_change_first_order'])}]"
                for m in metrics
            ),
            " ".join(row["notes"]),
        ]
        for row in variants
    ]
    head = ["not as drawn", *(label(m) for m in metrics), ""]
    kept = [k for k in range(len(head)) if k < len(head) - 1 or any(row[k] for row in rows)]
    return told + _table([[row[k] for k in kept] for row in rows], [head[k] for k in kept])


def _signed(value: float | None) -> str:
    return NONE if value is None else f"{value:+.3g}".replace("-", "−")


def warnings(run: Run) -> list[str]:
    """Return what a reader must know before trusting the figures, as sentences."""
    summary, found = run.summary.entries, []
    if not run.summary:
        found.append(
            "This run has no summary: it was stopped, or it still goes on. What is shown is the "
            "design so far, not a print."
        )
    if summary.get("printed_failure"):
        found.append(f"The print has no equilibrium: {summary['printed_failure']}")
    if run.note:
        found.append(f"At the design's pressure: {run.note}")
    errors = summary.get("errors") or {}
    if errors.get("failure"):
        found.append(f"The discretisation error is unknown: {errors['failure']}")
    curve = summary.get("curve") or {}
    for key, where in (("failure_below", "lower"), ("failure_above", "higher")):
        if curve.get(key):
            found.append(f"The curve ends before {where} pressures: {curve[key]}")
    if (summary.get("length_scale") or {}).get("satisfied") is False:
        found.append("The design violates its constraints on the widths of lines and gaps.")
    made = summary.get("manufacture") or {}
    for key, what in (
        ("islands", "island{s} of the print {hang} on nothing but the fabric"),
        ("narrow_places", "place{s} {are} narrower than the printer's least line"),
        ("tight_places", "gap{s} {are} narrower than the printer's least gap"),
    ):
        if number := made.get(key):
            found.append(f"{number} {what.format(**(ONE if number == 1 else MANY))}.")
    for name, frames in run.series.items():
        noted = [frame for frame in frames if frame.note and frame.note != run.note]
        if name != "iteration" and noted:
            at = ", ".join(_place(frame.values) for frame in noted[:6])
            more = ", …" if len(noted) > 6 else ""
            found.append(f"At {at}{more}: {noted[0].note}")
    return list(dict.fromkeys(found))


def _place(values: Mapping[str, float]) -> str:
    return f"{values.get('pressure_pa', 0.0) / 1e3:.4g} kPa"


def inputs(run: Run) -> str:
    """Return the tables of inputs and versions."""
    given = run.summary.entries.get("inputs") or {}
    versions = run.summary.entries.get("versions") or {}
    shown = [(key, "none" if value is None else str(value)) for key, value in given.items()]
    parts = []
    if shown:
        parts.append(
            "<h3>Inputs</h3><p>In SI units; angles as named.</p>" + _pairs(shown, "columns")
        )
    numbered = [(key, str(value)) for key, value in versions.items()]
    if versions:
        parts.append("<h3>Versions</h3>" + _pairs(numbered, "columns"))
    return "".join(parts)


def files(folder: Path) -> str:
    """Return the list of the run's files, as links beside the page."""
    rows = [
        f'<li><a href="{quote(name)}">{escape(name)}</a> <span>{escape(text)}</span></li>'
        for name, text in FILES.items()
        if (folder / name).exists()
    ]
    return f'<ul class="files">{"".join(rows)}</ul>' if rows else ""


def values_shown(values: Mapping[str, float]) -> list[tuple[str, str]]:
    """Return names and values with units of a frame's numbers."""
    return [as_shown(key, value) for key, value in values.items()]


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    return [*dict.fromkeys(key for row in rows for key in row)]


def _table(rows: Sequence[Sequence[str]], head: Sequence[str]) -> str:
    top = "".join(f"<th>{escape(text)}</th>" for text in head)
    body = "".join(
        f"<tr><th>{escape(row[0])}</th>"
        + "".join(f"<td>{escape(t)}</td>" for t in row[1:])
        + "</tr>"
        for row in rows
    )
    return (
        f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _pairs(pairs: Sequence[tuple[str, str]], look: str = "pairs") -> str:
    if not pairs:
        return ""
    entries = "".join(f"<div><dt>{escape(a)}</dt><dd>{escape(b)}</dd></div>" for a, b in pairs)
    return f'<dl class="{look}">{entries}</dl>'


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
