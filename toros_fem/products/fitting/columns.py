"""Columns of a tensile test's table: their names, their units, and the numbers in them."""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import DIMENSIONS, spelt
from toros_fem.base.validation import shown

# Returns a size of the specimen in m, by its kind.
Size = Callable[[str], float]


def _units(*dimensions: str) -> dict[str, float]:
    known = [one for dimension in dimensions for one in DIMENSIONS[dimension][1].items()]
    return {word: float(factor) for word, factor in known}


_RATIOS = {"1": 1.0, "-": 1.0, "%": 1e-2, "mm/mm": 1.0, "m/m": 1.0, "in/in": 1.0}
_LENGTHS = _units("m")
_FORCES = {**_units("N"), "lbf": 4.4482216152605, "kgf": 9.80665, "gf": 9.80665e-3}
# For each column its units, with their factors to SI units, and its other names: those of test
# machines, in English, German and French. A name before another is preferred to it. A stress of a
# sheet may come per width; it needs no thickness.
_COLUMNS: Mapping[str, tuple[Mapping[str, float], tuple[str, ...]]] = {
    "stretch": (_RATIOS, ("stretch ratio", "nominal stretch", "Streckung")),
    "strain": (
        _RATIOS,
        ("engineering strain", "nominal strain", "tensile strain", "percentage strain",
         "extensometer strain", "stroke strain", "Dehnung", "Zugdehnung", "Nenndehnung",
         "nominelle Dehnung", "technische Dehnung", "Standarddehnung", "déformation"),
    ),
    "extension": (
        _LENGTHS,
        ("displacement", "elongation", "tensile extension", "tensile displacement",
         "standard travel", "crosshead displacement", "crosshead travel", "crosshead extension",
         "crosshead", "stroke", "travel", "disp", "change in length", "Verlängerung",
         "Längenänderung", "Standardweg", "Traversenweg", "Verschiebung", "Kolbenweg", "Weg",
         "déplacement", "allongement", "position", "crosshead position", "Traversenposition"),
    ),
    "force": (
        _FORCES,
        ("load", "standard force", "tensile force", "tensile load", "test force", "Kraft",
         "Standardkraft", "Prüfkraft", "Zugkraft", "Last", "effort", "charge"),
    ),
    "stress": (
        _units("Pa", "N/m"),
        ("engineering stress", "nominal stress", "tensile stress", "Spannung", "Zugspannung",
         "Nennspannung", "contrainte"),
    ),
    "stress per width": (_units("N/m"), ("force per width", "Kraft je Breite")),
    "lateral stretch": (_RATIOS, ("transverse stretch",)),
    "lateral strain": (_RATIOS, ("transverse strain", "Querdehnung")),
    "lateral width": (_LENGTHS, ("current width", "aktuelle Breite")),
    "width": (
        _LENGTHS, ("specimen width", "initial width", "Breite", "Probenbreite", "largeur", "b0"),
    ),
    "thickness": (
        _LENGTHS,
        ("specimen thickness", "initial thickness", "Dicke", "Probendicke", "épaisseur", "a0"),
    ),
    "gauge length": (
        _LENGTHS,
        ("gage length", "specimen length", "initial length", "initial gauge length",
         "original gauge length", "grip to grip separation", "grip separation", "grip distance",
         "initial grip separation", "clamping length", "length", "L0", "Messlänge",
         "Anfangsmesslänge", "Ausgangslänge", "Anfangslänge", "Einspannlänge", "Probenlänge",
         "Klemmabstand", "Prüflänge", "longueur initiale", "longueur de référence", "longueur"),
    ),
    "specimen": (
        {}, ("sample", "specimen label", "specimen name", "sample name", "Probe", "Probenname"),
    ),
    "direction": ({}, ("Richtung",)),
}  # fmt: skip
# What may stand once for a whole file, in a line "# width = 25 mm"; examples for messages.
SIZES = MappingProxyType({"width": "25 mm", "thickness": "0.5 mm", "gauge length": "100 mm"})
WORDS = ("specimen", "direction")
# Most characters of a word.
LONGEST = 80
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {kind: units for kind, (units, _) in _COLUMNS.items() if units}
)
# What a table tells, and how it follows from the column that holds it and from sizes. Of several
# columns the first is taken whose sizes are known.
FORMULAS: Mapping[str, Mapping[str, Callable[[float, Size], float]]] = MappingProxyType(
    {
        "stretch": {
            "stretch": lambda stretch, size: stretch,
            "strain": lambda strain, size: 1 + strain,
            "extension": lambda way, size: 1 + way / size("gauge length"),
        },
        "force": {
            "stress per width": lambda force, size: force,
            "force": lambda force, size: force / size("width"),
            "stress": lambda stress, size: stress * size("thickness"),
        },
        "lateral stretch": {
            "lateral stretch": lambda stretch, size: stretch,
            "lateral strain": lambda strain, size: 1 + strain,
            "lateral width": lambda width, size: width / size("width"),
        },
    }
)
# Sizes that a column needs.
NEEDED = MappingProxyType(
    {"extension": "gauge length", "force": "width", "stress": "thickness", "lateral width": "width"}
)
# A name may be that of a strain or of a length, and its unit tells which: "Dehnung [mm]".
_SIBLINGS = {
    "strain": ("extension",),
    "extension": ("strain",),
    "force": ("stress per width", "stress"),
    "lateral strain": ("lateral width",),
}
# Other spellings of units, and units of columns that are left out.
_SPELLINGS = {
    "inch": "in", "inches": "in", '"': "in", "percent": "%", "pct": "%", "prozent": "%",
    "newton": "N", "newtons": "N", "micron": "µm", "./.": "1",
}  # fmt: skip
_OTHERS = ("s", "sec", "ms", "min", "h", "mm/min", "mm/s", "%/min", "°C", "C", "J", "mJ", "V", "Hz")
_ALL_UNITS = {unit for units in UNITS.values() for unit in units}
# Words as a header may end with: "[N]", "(N)", "/ N", ", N", "in N", "N".
_BRACKETS = re.compile(r"(.*?)\s*[\[(<{]\s*([^\])>}]*?)\s*[\])>}]")
_GAP = re.compile(r"\s*[,/]\s*|\s+in\s+|\s+")


def _plain(name: str) -> str:
    """Return a name without case, accents, marks and the channel "C_1_" before it."""
    bare = unicodedata.normalize("NFKD", name.casefold())
    bare = "".join(one for one in bare if not unicodedata.combining(one))
    for double in ("ae", "oe", "ue"):
        bare = bare.replace(double, double[0])
    return re.sub(r"^[a-z] \d+ (?=.)", "", " ".join(re.findall(r"\w+", bare.replace("_", " "))))


# What a column holds, by each name that it may have.
KINDS: Mapping[str, str] = MappingProxyType(
    {name: kind for kind, (_, others) in _COLUMNS.items() for name in (kind, *others)}
)
_KNOWN = {_plain(name): (kind, rank) for rank, (name, kind) in enumerate(KINDS.items())}
# A strain or a stretch without a unit is most likely in % from here on.
LARGEST_PLAIN = {"strain": 1.0, "stretch": 4.0}


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        kind: What it holds, a key of `UNITS` or one of `WORDS`.
        unit: Unit of its numbers; empty where there is none.

    Raises:
        ParameterError: It has no such unit.
    """

    kind: str
    unit: str = ""

    def __post_init__(self) -> None:
        kind, unit = self.kind, unit_of(self.unit)
        object.__setattr__(self, "unit", unit)
        if kind in WORDS and not unit:
            return
        known = list(UNITS[kind])
        if unit not in known and (unit or UNITS[kind] is not _RATIOS):
            what = f"is in {unit!r}" if unit else "has no unit"
            raise ParameterError(
                f"the column {kind!r} {what}; known are {', '.join(known)}. Write "
                f"'{kind} [{known[0]}]', or tell it by option, --unit \"{kind}={known[0]}\"."
            )

    @property
    def holds(self) -> str:
        """What its numbers are: a stress may be one per width."""
        return "stress per width" if self.unit in UNITS["stress per width"] else self.kind

    def value(self, text: str, comma: bool) -> float | str:
        """Return the number of a cell in SI units, or its words; decimal marks may be commas."""
        if self.kind in WORDS:
            return text[:LONGEST]
        number = number_of(text, comma)
        if not math.isfinite(number):
            what = f"= {shown(text)} is no finite number" if text else "is empty"
            raise ParameterError(f"{self.kind} {what}.{_comma_advice(text)}")
        found = UNITS[self.kind].get(self.unit, 1.0) * number
        if not self.unit and abs(found) > LARGEST_PLAIN.get(self.kind.split()[-1], math.inf):
            stretch = self.kind.replace("strain", "stretch")
            other = f"'{stretch}' if it is 1 at rest, " if stretch != self.kind else ""
            raise ParameterError(
                f"the {self.kind} is {found:.6g}; is it in %? Write '{self.kind} [%]', {other}or "
                f"'{self.kind} [1]' if it is a ratio; by option, --unit \"{self.kind}=%\"."
            )
        return found


def _comma_advice(text: str) -> str:
    if "," not in text:
        return ""
    return (
        " It has a comma, beside decimal points in other numbers: write points, or commas in all "
        "and separate the columns by semicolons."
    )


def number_of(text: str, comma: bool) -> float:
    """Return a number, NaN if it is none; with `comma` a comma is the decimal mark.

    Marks between thousands are taken out: "1,037.5", "1.037,5", "1'037.5", "1 037,5".
    """
    plain = re.sub(r"(?<=\d)['’\s](?=\d{3}(?!\d))", "", text.strip())
    if comma:
        if re.match(r"[+-]?[1-9]\d{0,2}(\.\d{3})+,", plain):
            plain = plain.replace(".", "")
        plain = plain.replace(",", ".")
    elif re.match(r"[+-]?[1-9]\d{0,2}(,\d{3})+\.", plain):
        plain = plain.replace(",", "")
    try:
        return float(plain) if "_" not in plain else math.nan
    except ValueError:
        return math.nan


def unit_of(word: str) -> str:
    """Return a unit as `UNITS` spells it, or the word itself where it is none of them."""
    plain = spelt(word.strip().strip("[](){}<>").strip())
    plain = _SPELLINGS.get(plain.casefold(), plain)
    if plain in _ALL_UNITS or plain == "MN":  # that is no mN
        return plain
    return next((one for one in _ALL_UNITS if one.casefold() == plain.casefold()), plain)


def are_units(cells: Sequence[str]) -> bool:
    """Return whether a row has units alone, as below the names of a table."""
    words = [cell.strip() for cell in cells if cell.strip()]
    units = [one for one in words if unit_of(one) in _ALL_UNITS or unit_of(one) in _OTHERS]
    plain = [one for one in units if math.isfinite(number_of(one, comma=True))]
    return len(plain) < len(units) and 2 * len(units) >= len(words)


def split_header(text: str) -> tuple[str, str]:
    """Return the name and the unit of "Load [N]", "Load" and "N"; the unit may be empty.

    Words in brackets that are no unit belong to the name: "Tensile strain (Extension)".
    """
    text = " ".join(text[:LONGEST].split())
    if match := _BRACKETS.fullmatch(text):
        name, inner = match.groups()
        if not inner or unit_of(inner) in _ALL_UNITS or not re.search(r"\w{4}|\s", inner):
            return name.strip(), unit_of(inner)
        return text, ""
    if _kind(text) is None:
        for gap in _GAP.finditer(text):
            name, unit = text[: gap.start()], unit_of(text[gap.end() :])
            if unit in _ALL_UNITS and unit not in ("1", "-") and _kind(name) is not None:
                return name, unit
    return text, ""


def _kind(name: str) -> tuple[str, int] | None:
    """Return what a column of a name holds, and the name's place among all; None of others."""
    plain = _plain(name)
    if plain in _KNOWN:
        return _KNOWN[plain]
    if match := _BRACKETS.fullmatch(name):
        return _kind(match[1])
    # A symbol or a number may follow: "Kraft F", "Load 1".
    short = re.sub(r" \w\d?$", "", plain)
    return _KNOWN.get(short)


def known_kind(name: str) -> str:
    """Return what a name stands for; empty if it is unknown."""
    found = _kind(name)
    return "" if found is None else found[0]


def found_columns(
    header: Sequence[str], units: Mapping[str, str], names: Mapping[str, str]
) -> Iterator[tuple[int, str, str, int]]:
    """Yield the columns that are known: place, what it holds, unit, and rank of its name.

    `units`, by what a column holds, and `names`, of the columns that hold it, come before those of
    the header.
    """
    said = {_plain(name): kind for kind, name in names.items()}
    for place, cell in enumerate(header):
        name, unit = split_header(cell)
        told = said.get(_plain(cell)) or said.get(_plain(name))
        kind, rank = (told, -1) if told else _kind(name) or ("", 0)
        if not kind or (not told and kind in names):
            continue
        if kind in WORDS:
            yield place, kind, "", rank
            continue
        unit = units.get(kind, unit)
        for other in _SIBLINGS.get(kind, ()):
            if not told and unit and unit not in UNITS[kind] and unit in UNITS[other]:
                kind, unit = other, units.get(other, unit)
        yield place, kind, unit, rank


def columns_of(
    header: Sequence[str],
    units: Mapping[str, str],
    names: Mapping[str, str] | None = None,
    sizes: Collection[str] = (),
) -> dict[int, Column]:
    """Return the columns that are read, by their places.

    Args:
        header: Names, with their units.
        units, names: By what a column holds; they come before those of the header.
        sizes: Sizes of the specimen that are known without the table. Of several columns that say
            the same, the first of `FORMULAS` is taken whose sizes are known.

    Raises:
        ParameterError: Two columns say the same, one is needed, or a name or a unit is wrong.
    """
    names = names or {}
    seen: dict[str, list[tuple[int, int, str]]] = {}
    for place, kind, unit, rank in found_columns(header, units, names):
        holds = kind
        if kind == "stress" and unit_of(unit) in UNITS["stress per width"]:
            holds = "stress per width"
        seen.setdefault(holds, []).append((rank, place, unit))
    for kind, name in names.items():
        if not any(one[0] < 0 for one in seen.get(kind, [])):
            raise ParameterError(
                f"no column is named {shown(name)}, which --column tells for the {kind}; the "
                f"header has {_listed(header)}."
            )
    known = {*sizes, *seen}
    chosen = [kind for kind in seen if not any(kind in one for one in FORMULAS.values())]
    for what, choice in FORMULAS.items():
        same = [kind for kind in choice if kind in seen]
        if not same and what != "lateral stretch":
            near = [
                f"; did you mean {close[0]!r} by {shown(cell.strip())}?"
                for cell in header
                if (name := split_header(cell)[0]) and not _kind(name)
                and (close := difflib.get_close_matches(name.lower(), KINDS, n=1, cutoff=0.8))
            ]  # fmt: skip
            raise ParameterError(
                f"no column holds the {what}: one of {', '.join(choice)} is needed; the header has "
                f"{_listed(header)}{near[0] if near else '.'} Rename the column, or tell which it "
                f'is by option, --column "{[*choice][-1 if what == "stretch" else 1]}=NAME".'
            )
        told = [kind for kind in same if kind in names]
        ready = [kind for kind in same if NEEDED.get(kind, kind) in known]
        chosen += [*told, *ready, *same][:1]
    found: dict[int, Column] = {}
    for kind in chosen:
        rank, place, unit = min(seen[kind])
        twice = [at for one, at, _ in seen[kind] if one == rank and at != place]
        if twice:
            both = " and ".join(shown(header[at].strip()) for at in (place, twice[0]))
            raise ParameterError(
                f"two columns hold the {kind}, {both}: take one out, or tell which by option, "
                f'--column "{kind}={header[place].strip()}".'
            )
        found[place] = Column(kind, unit)
    percent = any(one.unit == "%" and one.kind in FORMULAS["stretch"] for one in found.values())
    for one in found.values():  # a lateral strain in % is small enough to pass as a ratio
        if percent and one.kind == "lateral strain" and not one.unit:
            raise ParameterError(
                f"the column {one.kind!r} has no unit beside one in %: write '{one.kind} [%]', or "
                f"'{one.kind} [1]' if it is a ratio."
            )
    return found


def _listed(header: Sequence[str]) -> str:
    return shown(", ".join(cell.strip() for cell in header))
