"""Words and units of a report: keys of tables and summaries as a reader sees them."""

from __future__ import annotations

from collections.abc import Sequence

from toros_fem.measures.figures import Figure, formatted, split_key, unit_of
from toros_fem.results.result import Summary

# Units that metrics have, which a run that was stopped does not tell by its figures.
METRIC_UNITS = ("deg", "percent", "mm", "ratio")
# Columns of the history that do not name their unit.
BARE = {"pressure": "pa", "perimeter": "m"}


def metrics_of(summary: Summary, columns: Sequence[str]) -> list[Figure]:
    """Return the metrics among the columns of a table, with what the summary says of them."""
    found = []
    for key in columns:
        parts = split_key(key)
        if parts is not None and parts[1] in METRIC_UNITS:
            found.append(summary.figures.get(key, Figure(*parts, None)))
    return found


def label(figure: Figure) -> str:
    """Return name and unit, for an axis."""
    unit = unit_of(figure.unit).sign.strip()
    name = figure.name.replace("_", " ")
    return f"{name} (relative to rest)" if unit == "×" else f"{name} ({unit})"


def as_shown(key: str, value: float) -> tuple[str, str]:
    """Return the name and the value with unit of an entry of a table."""
    if key in BARE:
        return key, formatted(value, BARE[key])
    parts = split_key(key)
    if parts is None:
        return key.replace("_", " "), f"{value:.4g}"
    return parts[0].replace("_", " "), formatted(value, parts[1])
