"""Figures that a run tells: a value, how far it may be off, and the target that it should have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

# Part of its target that a figure may miss it by; of the size of the metric where the target is 0.
TOLERANCE = 0.03
# What stands for a value that is missing.
NONE = "–"


class Unit(NamedTuple):
    """How a unit is shown: in words, after a number, and by which factor numbers grow."""

    words: str
    sign: str
    factor: float = 1.0


# Units by the endings that they have in the keys of tables.
UNITS: Mapping[str, Unit] = {
    "deg": Unit("degrees", "°"),
    "percent": Unit("per cent", " %"),
    "mm": Unit("mm", " mm"),
    "ratio": Unit("times the rest value", "×"),
    "pa": Unit("kPa", " kPa", 1e-3),
    "m3": Unit("ml", " ml", 1e6),
    "m": Unit("mm", " mm", 1e3),
    "kg": Unit("g", " g", 1e3),
    "j": Unit("mJ", " mJ", 1e3),
    "n": Unit("N", " N"),
    "n_per_m": Unit("N/m", " N/m"),
    "use": Unit("per cent", " %", 1e2),
    "fraction": Unit("1", ""),
}


def unit_of(ending: str) -> Unit:
    """Return how a unit is shown; one that is not known is shown as it is written."""
    return UNITS.get(ending, Unit(ending, f" {ending}"))


def split_key(key: str) -> tuple[str, str] | None:
    """Return name and unit of a key such as "angle_deg"; None if it ends in no known unit."""
    for unit in ("n_per_m", key.rpartition("_")[2]):
        if unit in UNITS and key.endswith(f"_{unit}"):
            return key.removesuffix(f"_{unit}"), unit
    return None


@dataclass(frozen=True)
class Figure:
    """A number that a run tells.

    Attributes:
        name: Its name, such as "angle".
        unit: Its unit as an ending of `UNITS`, such as "deg".
        value: Its value; None where there is no equilibrium.
        interval: Half-width of the interval that holds the true value; None if it is unknown.
        target: Value that was asked for; None if none was.
        tolerance: Distance from the target that counts as reached; None without a target.
    """

    name: str
    unit: str
    value: float | None
    interval: float | None = None
    target: float | None = None
    tolerance: float | None = None

    @property
    def key(self) -> str:
        """Name in tables, such as "angle_deg"."""
        return f"{self.name}_{self.unit}"

    @property
    def miss(self) -> float | None:
        """Value minus target; None where one of them is missing."""
        return None if self.value is None or self.target is None else self.value - self.target

    @property
    def misses(self) -> bool:
        """Whether the value, as it is, is further from its target than the tolerance."""
        return (
            self.miss is not None and self.tolerance is not None and abs(self.miss) > self.tolerance
        )

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached, whatever the true value in the interval is.

        None without a target, without an interval, and where some values of the interval are within
        the tolerance and others are not. Without an equilibrium it is False.
        """
        if self.target is None or self.tolerance is None:
            return None
        if self.value is None:
            return False
        if self.interval is None:
            return None
        missed = abs(self.value - self.target)
        if missed + self.interval <= self.tolerance:
            return True
        return False if missed - self.interval > self.tolerance else None

    def as_dict(self) -> dict[str, Any]:
        """Return it as summaries hold it."""
        return {**asdict(self), "reached": self.reached}

    @property
    def shown(self) -> str:
        """Value and interval with their unit, such as "178.81 ± 0.47°"."""
        if self.value is None:
            return "no equilibrium"
        unit = unit_of(self.unit)
        value = unit.factor * self.value
        if self.interval is None:
            return formatted(self.value, self.unit)
        width = unit.factor * self.interval
        digits = max(0, 1 - int(np.floor(np.log10(width)))) if width > 0 else 3
        digits = min(digits, 4)
        return f"{value:.{digits}f} ± {width:.{digits}f}{unit.sign}"

    @property
    def words(self) -> str:
        """Name, value and target, such as "angle 178.81 ± 0.47° of 180°"."""
        name = self.name.replace("_", " ")
        of = "" if self.target is None else f" of {formatted(self.target, self.unit)}"
        return f"{name} {self.shown}{of}"


def formatted(value: float | None, unit: str, digits: int = 4, *, sign: bool = False) -> str:
    """Return a value, or a change of it, with its unit, such as "180°"; a dash for None.

    The unit is an ending of `UNITS`; with `sign` a change is written as "+3°".
    """
    if value is None:
        return NONE
    known = unit_of(unit)
    shown = round(known.factor * value, 6) + 0.0  # what is smaller is rounding
    return f"{shown:{'+' * sign}.{digits}g}{known.sign}".replace("-", "−" if sign else "-")
