"""Columns of a tensile test's table: their names and units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from toros_fem.base.errors import ParameterError
from toros_fem.base.units import DIMENSIONS, spelt

# For each column: what it measures, as `DIMENSIONS` and `_RATIOS` name it, and its other names.
# A stress of a sheet may come per width; it needs no thickness.
_COLUMNS: Mapping[str, tuple[str, tuple[str, ...]]] = MappingProxyType(
    {
        "stretch": ("ratio", ("stretch ratio", "nominal stretch")),
        "strain": ("ratio", ("engineering strain", "nominal strain", "tensile strain")),
        "extension": ("m", ("displacement", "elongation")),
        "force": ("N", ("load", "standard force")),
        "stress": ("Pa, N/m", ("engineering stress", "nominal stress", "tensile stress")),
        "lateral stretch": ("ratio", ("transverse stretch",)),
        "lateral strain": ("ratio", ("transverse strain",)),
        "lateral width": ("m", ("current width",)),
        "width": ("m", ("specimen width",)),
        "thickness": ("m", ("specimen thickness",)),
        "gauge length": ("m", ("specimen length",)),
        "specimen": ("", ("sample",)),
        "direction": ("", ()),
    }
)
# Columns that say the same thing in different ways.
ALONG = ("stretch", "strain", "extension")
LOADS = ("force", "stress")
ACROSS = ("lateral stretch", "lateral strain", "lateral width")
# What may stand once for a whole file, in a line "# width = 25 mm"; examples for messages.
SIZES = MappingProxyType({"width": "25 mm", "thickness": "0.5 mm", "gauge length": "100 mm"})
WORDS = ("specimen", "direction")
PER_WIDTH = DIMENSIONS["N/m"][1]

_RATIOS = {"1": 1.0, "-": 1.0, "%": 1e-2, "mm/mm": 1.0, "m/m": 1.0}
_HEADER = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*")


def _units_of(dimensions: str) -> dict[str, float]:
    if dimensions == "ratio":
        return _RATIOS
    return {
        word: float(factor)
        for dimension in dimensions.split(", ")
        for word, factor in DIMENSIONS[dimension][1].items()
    }


# Factor of each unit of each column of numbers, to SI units.
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {kind: _units_of(dimensions) for kind, (dimensions, _) in _COLUMNS.items() if dimensions}
)
# What a column holds, by each name that it may have.
KINDS: Mapping[str, str] = MappingProxyType(
    {name: kind for kind, (_, others) in _COLUMNS.items() for name in (kind, *others)}
)


def split_header(text: str) -> tuple[str, str]:
    """Return name and unit of a column's header: "Force [N]" is "force" and "N".

    The unit stands in brackets; it is empty where there is none.
    """
    match = _HEADER.fullmatch(text)
    name, unit = (text, None) if match is None else match.groups()
    return " ".join(name.replace("_", " ").lower().split()), unit or ""


def factor_of(kind: str, unit: str) -> float:
    """Return the factor of a column's unit, to SI units.

    Raises:
        ParameterError: There is no such column of numbers, or it has no such unit.
    """
    if kind in WORDS and not unit:
        return 1.0
    if kind not in UNITS:
        raise ParameterError(f"unit of {kind!r}: no such column; known are {', '.join(UNITS)}.")
    known = UNITS[kind]
    if spelt(unit) in known:
        return known[spelt(unit)]
    first = next(iter(known))
    if unit:
        raise ParameterError(f"the column {kind!r} is in {unit!r}; known are {', '.join(known)}.")
    if known is _RATIOS:
        return 1.0
    raise ParameterError(
        f"the column {kind!r} has no unit: write '{kind} [{first}]', or give the unit by option, "
        f'--unit "{kind}={first}".'
    )
