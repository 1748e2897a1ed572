"""Columns of a tensile test's table: their names, their units, and the numbers in them."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from toros_fem.base.errors import ParameterError
from toros_fem.base.units import DIMENSIONS, spelt
from toros_fem.base.validation import shown

# Returns a size of the specimen in m, by its kind.
Size = Callable[[str], float]


def _units(*dimensions: str) -> dict[str, float]:
    known = [one for dimension in dimensions for one in DIMENSIONS[dimension][1].items()]
    return {word: float(factor) for word, factor in known}


_RATIOS = {"1": 1.0, "-": 1.0, "%": 1e-2, "mm/mm": 1.0, "m/m": 1.0}
_LENGTHS = _units("m")
# For each column its units, with their factors to SI units, and its other names. A stress of a
# sheet may come per width; it needs no thickness.
_COLUMNS: Mapping[str, tuple[Mapping[str, float], tuple[str, ...]]] = {
    "stretch": (_RATIOS, ("stretch ratio", "nominal stretch")),
    "strain": (_RATIOS, ("engineering strain", "nominal strain", "tensile strain")),
    "extension": (_LENGTHS, ("displacement", "elongation")),
    "force": (_units("N"), ("load", "standard force")),
    "stress": (_units("Pa", "N/m"), ("engineering stress", "nominal stress", "tensile stress")),
    "stress per width": (_units("N/m"), ("force per width",)),
    "lateral stretch": (_RATIOS, ("transverse stretch",)),
    "lateral strain": (_RATIOS, ("transverse strain",)),
    "lateral width": (_LENGTHS, ("current width",)),
    "width": (_LENGTHS, ("specimen width",)),
    "thickness": (_LENGTHS, ("specimen thickness",)),
    "gauge length": (_LENGTHS, ("specimen length",)),
    "specimen": ({}, ("sample",)),
    "direction": ({}, ()),
}
# What may stand once for a whole file, in a line "# width = 25 mm"; examples for messages.
SIZES = MappingProxyType({"width": "25 mm", "thickness": "0.5 mm", "gauge length": "100 mm"})
WORDS = ("specimen", "direction")
# Most characters of a word.
LONGEST = 80
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {kind: units for kind, (units, _) in _COLUMNS.items() if units}
)
# What a column holds, by each name that it may have.
KINDS: Mapping[str, str] = MappingProxyType(
    {name: kind for kind, (_, others) in _COLUMNS.items() for name in (kind, *others)}
)
# What a table tells, and how it follows from the column that holds it and from sizes.
FORMULAS: Mapping[str, Mapping[str, Callable[[float, Size], float]]] = MappingProxyType(
    {
        "stretch": {
            "stretch": lambda stretch, size: stretch,
            "strain": lambda strain, size: 1 + strain,
            "extension": lambda way, size: 1 + way / size("gauge length"),
        },
        "force": {
            "force": lambda force, size: force / size("width"),
            "stress": lambda stress, size: stress * size("thickness"),
            "stress per width": lambda force, size: force,
        },
        "lateral stretch": {
            "lateral stretch": lambda stretch, size: stretch,
            "lateral strain": lambda strain, size: 1 + strain,
            "lateral width": lambda width, size: width / size("width"),
        },
    }
)
# A strain or a stretch without a unit is most likely in % from here on.
LARGEST_PLAIN = {"strain": 1.0, "stretch": 4.0}

_HEADER = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*")


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        kind: What it holds, a key of `UNITS` or one of `WORDS`.
        unit: Unit of its numbers; empty where there is none.

    Raises:
        ParameterError: There is no such column of numbers, or it has no such unit.
    """

    kind: str
    unit: str = ""

    def __post_init__(self) -> None:
        kind, unit = self.kind, spelt(self.unit)
        object.__setattr__(self, "unit", unit)
        if kind in WORDS and not unit:
            return
        if kind not in UNITS:
            raise ParameterError(f"unit of {kind!r}: no such column; known are {', '.join(UNITS)}.")
        known = list(UNITS[kind])
        if unit and unit not in known:
            raise ParameterError(
                f"the column {kind!r} is in {unit!r}; known are {', '.join(known)}."
            )
        if not unit and UNITS[kind] is not _RATIOS:
            raise ParameterError(
                f"the column {kind!r} has no unit: write '{kind} [{known[0]}]', or give the unit "
                f'by option, --unit "{kind}={known[0]}".'
            )

    @property
    def holds(self) -> str:
        """What its numbers are: a stress may be one per width."""
        return "stress per width" if self.unit in UNITS["stress per width"] else self.kind

    def value(self, text: str, mark: str) -> float | str:
        """Return the number of a cell in SI units, or its words; `mark` separates the columns."""
        if self.kind in WORDS:
            return text[:LONGEST]
        plain = pointed(self.kind, text, mark)
        try:
            number = float(plain) if "_" not in plain else math.nan
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            what = f"= {shown(text)} is no finite number" if text else "is empty"
            raise ParameterError(f"{self.kind} {what}.")
        found = UNITS[self.kind].get(self.unit, 1.0) * number
        if not self.unit and abs(found) > LARGEST_PLAIN.get(self.kind.split()[-1], math.inf):
            stretch = self.kind.replace("strain", "stretch")
            other = f"'{stretch}' if it is 1 at rest, " if stretch != self.kind else ""
            raise ParameterError(
                f"the {self.kind} is {found:.6g}; is it in %? Write '{self.kind} [%]', {other}or "
                f"'{self.kind} [1]' if it is a ratio."
            )
        return found


def pointed(kind: str, text: str, mark: str) -> str:
    """Return a number's text with a decimal point; a comma is one where it separates no columns."""
    if mark == "," and "," in text:
        raise ParameterError(
            f"{kind} = {shown(text)} has a comma, which separates the columns here: write a "
            "decimal point, or separate the columns by semicolons."
        )
    return text.replace(",", ".")


def split_header(text: str) -> tuple[str, str]:
    """Return the name and the unit of "Load [N]", "load" and "N"; it is empty without brackets."""
    match = _HEADER.fullmatch(text := text[:LONGEST])
    name, unit = (text, None) if match is None else match.groups()
    return " ".join(name.replace("_", " ").lower().split()), unit or ""


def columns_of(header: Sequence[str], units: Mapping[str, str]) -> dict[int, Column]:
    """Return the columns that are known, by their places.

    `units`, by what a column holds, come before those of the header.

    Raises:
        ParameterError: Two columns say the same, one is needed, or a name or a unit is wrong.
    """
    found: dict[int, Column] = {}
    for place, cell in enumerate(header):
        name, unit = split_header(cell)
        if kind := KINDS.get(name):
            found[place] = Column(kind, "" if kind in WORDS else units.get(kind, unit))
        elif near := difflib.get_close_matches(name, KINDS, n=1, cutoff=0.8):
            raise ParameterError(f"unknown column {shown(cell)}; did you mean {near[0]!r}?")
    kinds = [one.holds for one in found.values()]
    if twice := next((kind for kind in kinds if kinds.count(kind) > 1), None):
        raise ParameterError(f"two columns hold the {twice}.")
    percent = any(one.unit == "%" and one.kind in FORMULAS["stretch"] for one in found.values())
    for one in found.values():  # a lateral strain in % is small enough to pass as a ratio
        if percent and one.kind == "lateral strain" and not one.unit:
            raise ParameterError(
                f"the column {one.kind!r} has no unit beside one in %: write '{one.kind} [%]', or "
                f"'{one.kind} [1]' if it is a ratio."
            )
    for what, choice in FORMULAS.items():
        same = [kind for kind in kinds if kind in choice]
        if len(same) > 1:
            raise ParameterError(f"{' and '.join(same)} say the same: leave all but one out.")
        if not same and what != "lateral stretch":
            names = shown(", ".join(cell.strip() for cell in header))
            raise ParameterError(
                f"no column holds the {what}: one of {', '.join(choice)} is needed; the header has "
                f"{names}."
            )
    return found
