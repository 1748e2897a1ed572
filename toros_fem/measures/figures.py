"""Figures that a run tells: a value, how far it may be off, and the target that it should have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

# Part of its target that a figure may miss it by.
TOLERANCE = 0.03
# Figures that a sentence tells at most.
MOST_TOLD = 3
# Decimals that are added at most so that rounded numbers agree with a state.
MORE_DIGITS = 3
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


class State(StrEnum):
    """Whether a target is reached."""

    REACHED = "reached"
    MISSED = "missed"
    NOT_CERTAIN = "not certain"


@dataclass(frozen=True)
class Tolerances:
    """How far results may be from what was asked for, and still count as reached.

    Attributes:
        figure: Part of its target that a figure may be off by.
        shape: Part of the skin's length that a shape may be off by, as root mean square.
        direction: Angle in degrees that the direction of a tip may be off by.
    """

    figure: float = TOLERANCE
    shape: float = TOLERANCE
    direction: float = 5.0


DEFAULT = Tolerances()


@dataclass(frozen=True)
class Figure:
    """A number that a run tells.

    Attributes:
        name: Its name, such as "angle".
        unit: Its unit as an ending of `UNITS`, such as "deg".
        value: Its value; None where there is no equilibrium.
        interval: Half-width of the interval that holds the true value; None if it is unknown.
        target: Value that was asked for; None if none was.
        tolerance: Distance from the target that counts as reached; None where nothing decides.
        at_least: Whether more than the target is as good.
    """

    name: str
    unit: str
    value: float | None
    interval: float | None = None
    target: float | None = None
    tolerance: float | None = None
    at_least: bool = False

    @property
    def key(self) -> str:
        """Name in tables, such as "angle_deg"."""
        return f"{self.name}_{self.unit}"

    @property
    def label(self) -> str:
        """Name in words."""
        return self.name.replace("_", " ")

    @property
    def miss(self) -> float | None:
        """Value minus target; 0 beyond one that is a least value; None where one is missing."""
        if self.value is None or self.target is None:
            return None
        off = self.value - self.target
        return min(off, 0.0) if self.at_least else off

    @property
    def state(self) -> State | None:
        """Whether the target is reached; None without a target or a tolerance.

        It is reached if all values of the interval are within the tolerance, missed if none is, or
        without an equilibrium, else not certain. Nothing whose error is unknown is reached: it is
        missed if the value is outside.
        """
        if self.target is None or self.tolerance is None:
            return None
        if self.value is None:
            return State.MISSED
        off = self.target - self.value
        off = off if self.at_least else abs(off)
        if off - (self.interval or 0.0) > self.tolerance:
            return State.MISSED
        if self.interval is not None and off + self.interval <= self.tolerance:
            return State.REACHED
        return State.NOT_CERTAIN

    def as_dict(self) -> dict[str, Any]:
        """Return it as summaries hold it."""
        reached = {State.REACHED: True, State.MISSED: False}.get(self.state)  # type: ignore[arg-type]
        found = {**asdict(self), "state": self.state, "reached": reached}
        if not self.at_least:
            del found["at_least"]
        return found

    def rounded(self, value: float, *, unit: bool = True) -> str:
        """Return a value, or a change of it, with no more digits than the error supports.

        Where the error is unknown, they are those that the tolerance needs. Where the state is not
        that of the rounded numbers, there are more.
        """
        factor = unit_of(self.unit).factor
        if self.interval is None and self.tolerance is None:
            return formatted(value, self.unit)
        digits = self._digits
        if self.interval is None:
            return formatted(round(factor * value, digits) / factor, self.unit)
        text = f"{round(factor * value, digits) + 0.0:.{digits}f}"
        return f"{text}{unit_of(self.unit).sign * unit}"

    @property
    def _digits(self) -> int:
        """Decimals, in the unit that is shown, that keep the state."""
        factor = unit_of(self.unit).factor
        width = self.tolerance if self.interval is None else self.interval
        least = _digits(factor * (width or 0.0))
        wider = None if self.tolerance is None else (1 + 1e-9) * self.tolerance
        for digits in range(least, least + MORE_DIGITS):
            value, interval = (
                None if one is None else round(factor * one, digits) / factor
                for one in (self.value, self.interval)
            )
            if replace(self, value=value, interval=interval, tolerance=wider).state is self.state:
                return digits
        return least

    @property
    def shown(self) -> str:
        """Value and interval with their unit, such as "178.81 ± 0.47°"."""
        if self.value is None:
            return "no equilibrium"
        if self.interval is None:
            return self.rounded(self.value)
        width = self.rounded(self.interval)
        return f"{self.rounded(self.value, unit=False)} ± {width}"

    @property
    def asked(self) -> str:
        """Target and tolerance with their unit, such as "180 ± 5.4°"; empty without a target."""
        if self.target is None:
            return ""
        if self.tolerance is None:
            return formatted(self.target, self.unit)
        within = self.allowed
        if self.target == 0:
            return f"at most {within}"
        if self.at_least:
            return f"at least {formatted(self.target - self.tolerance, self.unit, 3)}"
        target = formatted(self.target, self.unit).removesuffix(unit_of(self.unit).sign)
        return f"{target} ± {within}"

    @property
    def allowed(self) -> str:
        """The tolerance with its unit."""
        return formatted(self.tolerance, self.unit, 2)

    def off(self, *, with_error: bool = False) -> str:
        """How far the value is from the target in words, such as "5.9° short of 180°".

        With the half-width of its interval it is "5.9 ± 1.1° short of 180°".
        """
        if self.miss is None or self.target is None:
            return self.shown
        wide = self.interval if with_error else None
        far = self.rounded(abs(self.miss), unit=wide is None)
        far += "" if wide is None else f" ± {self.rounded(wide)}"
        if self.target == 0:
            return far
        if round(unit_of(self.unit).factor * self.miss, self._digits) == 0:
            return f"as asked, {formatted(self.target, self.unit)}"
        side = "short of" if abs(self.value or 0.0) < abs(self.target) else "beyond"
        far = far.replace(" %", " percentage points")
        return f"{far} {side} {formatted(self.target, self.unit)}"

    @property
    def why(self) -> str:
        """Why its state is what it is, such as "angle 5.9° short of 180° (± 1.1°, …)"."""
        if self.value is None or self.tolerance is None:
            return f"{self.label}: {self.shown}"
        width = self.interval
        known = "its error is unknown" if width is None else f"± {self.rounded(width)}"
        return f"{self.label} {self.off()} ({known}; within {self.allowed} is reached)"

    @property
    def words(self) -> str:
        """Name, value and target, such as "angle 178.81 ± 0.47° of 180°"; of 0, its tolerance."""
        of = "" if self.target is None else f" of {formatted(self.target, self.unit)}"
        if self.target == 0 and self.tolerance is not None:
            of = f" ({self.asked})"
        return f"{self.label} {self.shown}{of}"


def axis_label(figures: Sequence[Figure]) -> str:
    """Return the names of figures of one unit, two at most, and the unit, for an axis."""
    names = " and ".join(figure.label for figure in figures) if len(figures) < 3 else ""
    sign = unit_of(figures[0].unit).sign.strip()
    sign = "relative to rest" if sign == "×" else sign
    return f"{names} ({sign})" if sign else names


def _digits(width: float) -> int:
    """Return the decimals that two digits of an error need, 4 at most."""
    digits = max(0, 1 - int(np.floor(np.log10(width)))) if width > 0 else 3
    return min(digits, 4)


def overall(figures: Iterable[Figure]) -> State | None:
    """Return the state of all figures together: the worst; None if none has one."""
    return worst(figure.state for figure in figures)


def worst(states: Iterable[State | None]) -> State | None:
    """Return the state that decides; None if there is none."""
    order = (State.MISSED, State.NOT_CERTAIN, State.REACHED)
    return min(filter(None, states), key=order.index, default=None)


def verdict_of(figures: Sequence[Figure]) -> str:
    """Return in a sentence whether all targets are reached, and the worst; empty without any."""
    state = overall(figures)
    if state is None:
        return ""
    if state is State.MISSED and any(f.value is None and f.state for f in figures):
        return "Missed: the print has no equilibrium"
    if state is State.REACHED:
        return "Reached"
    found = sorted((f for f in figures if f.state is state), key=_weight, reverse=True)
    told = "; ".join(figure.why for figure in found[:MOST_TOLD])
    more = len(found) - MOST_TOLD
    return f"{state.capitalize()}: {told}{f'; and {more} more' if more > 0 else ''}"


def worst_of(figures: Sequence[Figure]) -> Figure | None:
    """Return the figure that decides: of the worst state, and furthest off; None without any.

    A figure whose target is a number comes before a distance, whose target is 0.
    """
    state = overall(figures)
    found = [figure for figure in figures if state is not None and figure.state is state]
    return max(found, key=_weight, default=None)


def _weight(figure: Figure) -> tuple[bool, float]:
    far = np.inf if figure.miss is None else abs(figure.miss) / (figure.tolerance or 1.0)
    return figure.target != 0, far


def largest_part(figures: Sequence[Figure]) -> float:
    """Return the largest distance of a figure from its target over its tolerance."""
    off = [abs(f.miss / f.tolerance) for f in figures if f.tolerance and f.miss is not None]
    return max(off, default=0.0)


def formatted(value: float | None, unit: str, digits: int = 4, *, sign: bool = False) -> str:
    """Return a value, or a change of it, with its unit, such as "180°"; a dash for None.

    The unit is an ending of `UNITS`; with `sign` a change is written as "+3°".
    """
    if value is None:
        return NONE
    known = unit_of(unit)
    shown = round(known.factor * value, 6) + 0.0  # what is smaller is rounding
    return f"{shown:{'+' * sign}.{digits}g}{known.sign}".replace("-", "−" if sign else "-")
