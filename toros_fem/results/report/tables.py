"""Key figures, warnings and inputs of a run, as rows of text for a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from toros_fem.base.keys import duration
from toros_fem.base.validation import is_number
from toros_fem.measures.figures import NONE, Figure, axis_label, formatted, split_key, verdict_of
from toros_fem.measures.miss import is_of_shape
from toros_fem.results.runs.stored_run import Run, Summary, notes_at

# Units that metrics have, which a run that was stopped does not tell by its figures.
METRIC_UNITS = ("deg", "percent", "mm", "ratio")
# Columns of the history that do not name their unit.
BARE = {"pressure": "pa", "perimeter": "m"}
# What stands for the interval of a figure that is judged without one; warnings tell why.
UNKNOWN = "not estimated"
# Units of figures that a terminal does not tell.
UNTOLD = ("m3", "use")
Pairs = list[tuple[str, str]]


@dataclass(frozen=True)
class TextTable:
    """Rows of text under their heads; columns in which no row says anything are left out."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def __post_init__(self) -> None:
        kept = [
            k
            for k in range(len(self.head))
            if k == 0 or any(row[k] not in ("", NONE) for row in self.rows)
        ]
        object.__setattr__(self, "head", [self.head[k] for k in kept])
        object.__setattr__(self, "rows", [[row[k] for k in kept] for row in self.rows])


def metrics_of(summary: Summary, columns: Sequence[str]) -> list[Figure]:
    """Return the metrics among the columns of a table, with what the summary says of them."""
    found = []
    for key in columns:
        parts = split_key(key)
        if parts is not None and parts[1] in METRIC_UNITS:
            found.append(summary.figures.get(key, Figure(*parts, None)))
    return found


def as_shown(key: str, value: float) -> tuple[str, str]:
    """Return the name and the value with unit of an entry of a table."""
    if key in BARE:
        return key, formatted(value, BARE[key])
    parts = split_key(key)
    if parts is None:
        return key.replace("_", " "), f"{value:.4g}"
    return parts[0].replace("_", " "), formatted(value, parts[1])


def key_figures(run: Run) -> TextTable:
    """Return the metrics with error estimates, targets, and what the design had."""
    entries = run.summary.entries
    columns = dict.fromkeys(key for rows in (run.history, run.curve) for row in rows for key in row)
    known, rows = _designed(run.summary), []
    of_shape = filter(is_of_shape, run.summary.figures.values())
    for figure in (*metrics_of(run.summary, list(columns)), *of_shape):
        designed = known.get(figure.key)
        if not run.summary and run.history:
            designed = run.history[-1].get(figure.key)
        width, unit = figure.interval, figure.unit
        unknown = UNKNOWN if _of_unknown_error(figure) else NONE
        rows.append(
            [
                figure.label,
                formatted(figure.value, unit),
                unknown if width is None else f"± {formatted(float(f'{width:.2g}'), unit)}",
                figure.asked or NONE,
                formatted(designed, unit),
                figure.state or "",
            ]
        )
    value = "value" if run.summary and "design" not in entries else "as printed"
    return TextTable(["", value, "interval", "target", "as designed", "state"], rows)


def _designed(summary: Summary) -> Mapping[str, Any]:
    """Return what the design by densities had; nothing where laid lines are in its place."""
    laid = "lines" in summary.entries and not summary.entries.get("densities_kept")
    return {} if laid else summary.entries.get("design") or {}


def verdict(run: Run) -> tuple[str, list[str]]:
    """Return in a word whether all targets are reached, and why as sentences; "" without any."""
    word, _, why = verdict_of(list(run.summary.figures.values())).partition(": ")
    binding = (run.summary.entries.get("verdict") or {}).get("binding")
    found = [f"{why[:1].upper()}{why[1:]}."] if why else []
    return word, [*found, *([f"What binds: {'; '.join(binding)}."] if binding else [])]


def _of_unknown_error(figure: Figure) -> bool:
    """Return whether a figure is judged without an interval."""
    return figure.state is not None and figure.value is not None and figure.interval is None


def as_text(summary: Summary) -> str:
    """Return verdict, figures, what binds and warnings as lines for a terminal."""
    entries, designed = summary.entries, _designed(summary)
    figures = [
        figure
        for figure in summary.figures.values()
        if figure.unit not in UNTOLD and (figure.state or not is_of_shape(figure))
    ]
    rows = [
        [
            figure.label,
            figure.shown,
            figure.asked,
            figure.rounded(designed[figure.key]) if figure.key in designed else "",
            f"{figure.state or ''}{f' (error {UNKNOWN})' * _of_unknown_error(figure)}",
        ]
        for figure in figures
    ]
    value = "as printed" if "design" in entries or entries.get("pattern") else "value"
    table = TextTable(["", value, "target", "as designed", "state"], rows)
    widths = [max(map(len, column)) for column in zip(table.head, *table.rows, strict=True)]
    lines = [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in (table.head, *table.rows)
    ]
    state = (entries.get("verdict") or {}).get("state")
    seconds = (entries.get("seconds") or {}).get("total")
    told = [state.capitalize()] if state else []
    told += [f"  {line}" for line in lines if line]
    told += [f"  computed in {duration(seconds)}"] if seconds is not None else []
    for title, texts in (
        ("What binds:", (entries.get("verdict") or {}).get("binding") or ()),
        ("Warnings:", entries.get("warnings") or ()),
    ):
        told += [title, *(f"  {text}" for text in texts)] if texts else []
    return "\n".join(told)


def further_figures(run: Run) -> Pairs:
    """Return names and values of the other figures."""
    entries, found = run.summary.entries, Pairs()
    made = entries.get("manufacture") or {}
    for key in ("pressure_pa", "volume_m3"):
        if (value := run.summary.value(key)) is not None:
            found.append(as_shown(key, value))
    if (use := run.summary.value("stretch_use")) is not None:
        found.append(("of the stretch bounds", f"{100 * use:.0f} % used"))
    first, last = entries.get("objective_first"), entries.get("objective_last")
    if is_number(first) and is_number(last):
        found.append(("objective T", f"{first:.3g} → {last:.3g}"))
    for key, name in (("smallest_width", "narrowest line"), ("smallest_gap", "narrowest gap")):
        if is_number(made.get(f"{key}_mm")):
            found.append((name, f"{made[f'{key}_mm']:.3g} mm"))
    if is_number(made.get("pieces")):
        islands = f"{made['islands']} island{'s' * (made['islands'] != 1)}"
        found.append(("printed pieces", f"{made['pieces']}, of these {islands}"))
    if is_number(count := entries.get("triangles")):
        parts = entries.get("parts_by_symmetry", 1)
        found.append(("triangles", f"{parts} equal parts of {count}" if parts > 1 else f"{count}"))
    if run.history:
        found.append(("iterations", f"{run.history[-1]['iteration']:.0f}"))
    if is_number(seconds := (entries.get("seconds") or {}).get("total")):
        ranks = entries.get("ranks", 1)
        on = "" if ranks == 1 else f" on {ranks} ranks"
        found.append(("computing time", f"{seconds:.0f} s{on}"))
    return found


def tolerances(run: Run) -> tuple[list[str], TextTable]:
    """Return sentences on the worst of the skins that are not made as drawn, and all of them.

    Both are empty if none is there.
    """
    variants = run.tolerance.get("variants") or []
    metrics = metrics_of(run.summary, list(run.tolerance.get("nominal") or {}))
    if not variants or not metrics:
        return [], TextTable([], [])
    worst = [entry["sentence"] for entry in (run.tolerance.get("worst") or {}).values()]
    rows = [
        [
            f"{row['quantity']} {row['change']}",
            *(_signed(row[f"{metric.key}_change"]) for metric in metrics),
            " ".join(row["notes"]),
        ]
        for row in variants
    ]
    head = ["not as drawn", *(axis_label([metric]) for metric in metrics), ""]
    return list(dict.fromkeys(worst)), TextTable(head, rows)


def warnings(run: Run) -> list[str]:
    """Return what a reader must know before trusting the figures, as sentences."""
    if run.summary:
        return list(run.summary.entries.get("warnings") or ())
    notes = [
        (frame.values.get("pressure_pa", 0.0), frame.note)
        for name, frames in run.series.items()
        for frame in frames
        if name != "iteration"
    ]
    return [
        "This run has no summary: it was stopped, or it still goes on. What is shown is the "
        "design so far, not a print.",
        *notes_at(notes),
    ]


def inputs(run: Run) -> tuple[Pairs, Pairs]:
    """Return the inputs in SI units, and the versions."""
    given, versions = (run.summary.entries.get(key) or {} for key in ("inputs", "versions"))
    shown = [(key, "none" if value is None else str(value)) for key, value in given.items()]
    return shown, [(key, str(value)) for key, value in versions.items()]


def _signed(value: float | None) -> str:
    return NONE if value is None else f"{value:+.3g}".replace("-", "−")
