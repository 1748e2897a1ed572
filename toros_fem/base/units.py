"""Values with units, as text: "5 kPa" is 5000, in the unit of a field."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from decimal import Decimal, localcontext
from types import MappingProxyType

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import shown

# What each unit of a field measures, and all units that are read, as multiples of it.
_TABLE = {
    "m": ("a length", "m 1, cm 1e-2, mm 1e-3, um 1e-6, µm 1e-6, in 0.0254"),
    "m²": ("an area", "m² 1, m2 1, cm² 1e-4, cm2 1e-4, mm² 1e-6, mm2 1e-6"),
    "Pa": (
        "a pressure or a modulus",
        "Pa 1, hPa 1e2, kPa 1e3, MPa 1e6, GPa 1e9, mbar 1e2, bar 1e5, psi 6894.757293168361, "
        "N/mm² 1e6, N/mm2 1e6",
    ),
    "deg": ("an angle", f"deg 1, ° 1, rad {Decimal(180) / Decimal(repr(math.pi))}"),
    "kg": ("a mass", "kg 1, g 1e-3, mg 1e-6"),
    "kg/m²": ("a mass per area", "kg/m² 1, kg/m2 1, g/m² 1e-3, g/m2 1e-3"),
    "kg/m³": ("a density", "kg/m³ 1, kg/m3 1, g/cm³ 1e3, g/cm3 1e3"),
    "N": ("a force", "N 1, mN 1e-3, cN 1e-2, kN 1e3"),
    "N/m": ("a force per length", "N/m 1, N/cm 1e2, N/mm 1e3, kN/m 1e3"),
    "%": ("a fraction", "% 1"),
}
# The same with numbers: Decimal, so that "0.6 mm" is the same number as 0.6e-3.
DIMENSIONS: Mapping[str, tuple[str, Mapping[str, Decimal]]] = MappingProxyType(
    {
        unit: (what, {word: Decimal(by) for word, by in map(str.split, known.split(", "))})
        for unit, (what, known) in _TABLE.items()
    }
)
# Units that templates show, from small to large, where it is not the field's own.
SHOWN = {"m": ("mm",), "m²": ("mm²",), "Pa": ("Pa", "kPa", "MPa"), "kg": ("g",), "kg/m²": ("g/m²",)}
# Characters of the longest text that is a number with a unit.
LONGEST = 200
_VALUE = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


def spelt(word: str) -> str:
    """Return a unit as `DIMENSIONS` spells it: the micro sign for a Greek mu, "m2" for "m^2"."""
    return word.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}").replace("^", "")


def words_of(unit: str | None) -> Sequence[str]:
    """Return the units that a field takes; None for a pure number."""
    return () if unit is None else tuple(DIMENSIONS[unit][1])


def read_quantity(text: str, unit: str | None) -> float:
    """Return a number with its unit, "0.6 mm" for instance, in the unit of a field.

    The field's is one of `DIMENSIONS`; None for a pure number, which may come in %.

    Raises:
        ParameterError: There is no number, no unit, an unknown unit, or one of something else.
    """
    found = quantity(text, unit)
    if isinstance(found, str):
        raise ParameterError(f"{shown(text)} {found}")
    return found


def quantity(text: str, unit: str | None) -> float | str:
    """Return the number of `read_quantity`, or the end of a sentence that says why it is none."""
    known = "" if unit is None else "; known are " + ", ".join(words_of(unit))
    match = _VALUE.fullmatch(text[: LONGEST + 1])
    if match is None or len(text) > LONGEST:
        none = " This value cannot be left out." if text.strip().lower() == "none" else ""
        return f"does not start with a number{known}.{none}"
    number, word = match[1], spelt(match[2])
    if not word:
        advice = "without quotes" if unit is None else f"without quotes, in {unit}"
        return f"has no unit{known}; a plain number, {advice}."
    found = next((one for one, (_, words) in DIMENSIONS.items() if word in words), None)
    if found is None and re.match(r",\d", match[2]):
        point = f": {text.strip().replace(',', '.')!r}" * ("." not in number)
        return f"has a comma. Write a point{point or ', and one alone'}."
    if found is None:
        near = [one for one in words_of(unit) if one.lower() == word.lower()]
        advice = f"; did you mean {near[0]!r}?" if near else f"{known}."
        return f"has the unknown unit {shown(word)}{advice}"
    if found != (unit or "%"):
        wanted = "a pure number" if unit is None else DIMENSIONS[unit][0]
        return f"is {DIMENSIONS[found][0]}, but {wanted} is needed{known}."
    with localcontext(prec=40) as context:
        context.clear_traps()  # what overflows is infinite
        factor = DIMENSIONS[found][1][word] / (100 if unit is None else 1)
        value = float(Decimal(number) * factor)
    if not math.isfinite(value):
        return "is too large for a number."
    return value


def write_quantity(value: float, unit: str) -> str:
    """Return a finite number in the unit of a field with a handy unit, as `read_quantity` reads."""
    words, factors = SHOWN.get(unit, (unit,)), DIMENSIONS[unit][1]
    chosen = [words[0], *(word for word in words[1:] if abs(value) >= factors[word])][-1]
    with localcontext(prec=40):
        scaled = Decimal(repr(value)) / factors[chosen]
    # Plain where that is short: 150 rather than 1.5E+2.
    plain = f"{scaled:f}"
    if "." in plain:
        plain = plain.rstrip("0").rstrip(".")
    return f"{plain if len(plain) < 18 else scaled} {chosen}"


def duration(seconds: float) -> str:
    """Return a time in h, min or s, in about two digits."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    number, unit = (seconds / 60, "min") if seconds < 3600 else (seconds / 3600, "h")
    return f"{number:.1f} {unit}" if number < 10 else f"{number:.0f} {unit}"
