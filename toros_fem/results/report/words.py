"""Words and units of a report: keys of tables and summaries as a reader sees them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from toros_fem.measures.metrics import UNITS

# Endings of keys in SI units: sign of the unit shown, and the factor to it.
SI_ENDINGS = {"pa": ("kPa", 1e-3), "m3": ("ml", 1e6), "m": ("mm", 1e3), "kg": ("g", 1e3)}
# What stands for a value that is missing.
NONE = "–"
# Columns of the history that do not name their unit.
BARE = {"pressure": "pa", "perimeter": "m"}


@dataclass(frozen=True)
class Metric:
    """A metric of a run, found in its tables.

    Attributes:
        key: Its key in tables, such as "angle_deg".
        name: Its name, such as "angle".
        unit: Its unit as text, after a space where there must be one.
        target: Its target, or None.
    """

    key: str
    name: str
    unit: str
    target: float | None

    @property
    def label(self) -> str:
        """Name and unit, for an axis."""
        unit = self.unit.strip()
        return f"{self.name} (relative to rest)" if unit == "×" else f"{self.name} ({unit})"

    def formatted(self, value: float | None) -> str:
        """Return a value with its unit."""
        return NONE if value is None else f"{value:.4g}{self.unit}"


def metrics_of(summary: Mapping[str, Any], columns: list[str]) -> list[Metric]:
    """Return the metrics among the columns of a table, with their targets from the summary."""
    found = []
    for key in columns:
        name, _, unit = key.rpartition("_")
        if name and unit in UNITS and key != "stretch_use":
            target = summary.get(f"{name}_target_{unit}")
            words = name.replace("_", " ")
            found.append(Metric(key, words, UNITS[unit][1], target))
    return found


def as_shown(key: str, value: float) -> tuple[str, str]:
    """Return the name and the value with unit of an entry of a table."""
    if key in BARE:
        sign, factor = SI_ENDINGS[BARE[key]]
        return key, f"{factor * value:.4g} {sign}"
    name, _, unit = key.rpartition("_")
    words = name.replace("_", " ")
    if name and unit in UNITS:
        return words, f"{value:.4g}{UNITS[unit][1]}"
    if name and unit in SI_ENDINGS:
        sign, factor = SI_ENDINGS[unit]
        return words, f"{factor * value:.4g} {sign}"
    return key.replace("_", " "), f"{value:.4g}"
