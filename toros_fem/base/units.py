"""Values with units, as text: "5 kPa" is 5000, in the unit of a field."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from decimal import Decimal, localcontext
from types import MappingProxyType

from toros_fem.base.errors import ParameterError

# For each unit of a field: what it measures, and each unit that is read, over the field's own.
# Decimal, so that "0.6 mm" is the same number as 0.6e-3.
_PI = Decimal(repr(math.pi))
DIMENSIONS: Mapping[str, tuple[str, Mapping[str, Decimal]]] = MappingProxyType(
    {
        "m": (
            "a length",
            {
                "m": Decimal(1),
                "cm": Decimal("1e-2"),
                "mm": Decimal("1e-3"),
                "um": Decimal("1e-6"),
                "µm": Decimal("1e-6"),
                "in": Decimal("0.0254"),
            },
        ),
        "m²": (
            "an area",
            {
                "m²": Decimal(1),
                "m2": Decimal(1),
                "cm²": Decimal("1e-4"),
                "cm2": Decimal("1e-4"),
                "mm²": Decimal("1e-6"),
                "mm2": Decimal("1e-6"),
            },
        ),
        "Pa": (
            "a pressure or a modulus",
            {
                "Pa": Decimal(1),
                "hPa": Decimal("1e2"),
                "kPa": Decimal("1e3"),
                "MPa": Decimal("1e6"),
                "GPa": Decimal("1e9"),
                "mbar": Decimal("1e2"),
                "bar": Decimal("1e5"),
                "N/mm²": Decimal("1e6"),
                "N/mm2": Decimal("1e6"),
            },
        ),
        "deg": (
            "an angle",
            {"deg": Decimal(1), "°": Decimal(1), "rad": Decimal(180) / _PI},
        ),
        "kg": ("a mass", {"kg": Decimal(1), "g": Decimal("1e-3"), "mg": Decimal("1e-6")}),
        "kg/m²": (
            "a mass per area",
            {
                "kg/m²": Decimal(1),
                "kg/m2": Decimal(1),
                "g/m²": Decimal("1e-3"),
                "g/m2": Decimal("1e-3"),
            },
        ),
        "kg/m³": (
            "a density",
            {
                "kg/m³": Decimal(1),
                "kg/m3": Decimal(1),
                "g/cm³": Decimal("1e3"),
                "g/cm3": Decimal("1e3"),
            },
        ),
        "N": (
            "a force",
            {"N": Decimal(1), "mN": Decimal("1e-3"), "cN": Decimal("1e-2"), "kN": Decimal("1e3")},
        ),
        "N/m": (
            "a force per length",
            {
                "N/m": Decimal(1),
                "N/cm": Decimal("1e2"),
                "N/mm": Decimal("1e3"),
                "kN/m": Decimal("1e3"),
            },
        ),
        "%": ("a fraction", {"%": Decimal(1)}),
    }
)
_VALUE = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


def spelt(word: str) -> str:
    """Return a unit as `DIMENSIONS` spells it: the micro sign for a Greek mu, "m2" for "m^2"."""
    return word.replace("\N{GREEK SMALL LETTER MU}", "\N{MICRO SIGN}").replace("^", "")


def measured_by(word: str) -> str | None:
    """Return the field unit that a unit belongs to: "Pa" for "kPa"; None if it is unknown."""
    for unit, (_, known) in DIMENSIONS.items():
        if word in known:
            return unit
    return None


def read_quantity(text: str, unit: str | None) -> float:
    """Return a number with its unit, in the unit of a field.

    Args:
        text: A number and a unit, "0.6 mm" for instance.
        unit: Unit of the field, one of `DIMENSIONS`; None for a pure number, which may come in %.

    Raises:
        ParameterError: There is no number, no unit, an unknown unit, or one of something else.
    """
    match = _VALUE.fullmatch(text)
    if match is None:
        raise ParameterError(f"{text!r} does not start with a number{_example(unit)}.")
    number, word = match[1], spelt(match[2])
    if not word:
        advice = "without quotes" if unit is None else f"without quotes, in {unit}"
        raise ParameterError(f"{text!r} has no unit{_example(unit)}; a plain number, {advice}.")
    found = measured_by(word)
    if found is None:
        raise ParameterError(f"{text!r} has the unknown unit {word!r}{_example(unit)}.")
    if unit is None and found == "%":
        factor = Decimal("1e-2")
    elif found == unit:
        factor = DIMENSIONS[found][1][word]
    else:
        wanted = "a pure number" if unit is None else DIMENSIONS[unit][0]
        raise ParameterError(
            f"{text!r} is {DIMENSIONS[found][0]}, but {wanted} is needed{_example(unit)}."
        )
    with localcontext(prec=40):
        value = float(Decimal(number) * factor)
    if not math.isfinite(value):
        raise ParameterError(f"{text!r} is too large for a number.")
    return value


def _example(unit: str | None) -> str:
    """Return the units that are read, in words."""
    if unit is None:
        return ""
    return "; known are " + ", ".join(DIMENSIONS[unit][1])


# Units that templates show, from small to large.
SHOWN: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "m": ("mm",),
        "m²": ("mm²",),
        "Pa": ("Pa", "kPa", "MPa"),
        "deg": ("deg",),
        "kg": ("g",),
        "kg/m²": ("g/m²",),
        "kg/m³": ("kg/m³",),
        "N": ("N",),
        "N/m": ("N/m",),
        "%": ("%",),
    }
)


def write_quantity(value: float, unit: str) -> str:
    """Return a number with a handy unit, which `read_quantity` turns into the same number.

    Args:
        value: A finite number in the unit of a field.
        unit: Unit of the field.
    """
    chosen = SHOWN[unit][0]
    for word in SHOWN[unit][1:]:
        if abs(value) >= float(DIMENSIONS[unit][1][word]):
            chosen = word
    with localcontext(prec=40):
        scaled = Decimal(repr(value)) / DIMENSIONS[unit][1][chosen]
    # Plain where that is short: 150 rather than 1.5E+2.
    plain = f"{scaled:f}"
    if "." in plain:
        plain = plain.rstrip("0").rstrip(".")
    return f"{plain if len(plain) < 18 else scaled} {chosen}"
