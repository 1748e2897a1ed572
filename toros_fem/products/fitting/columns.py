"""Columns of a tensile test's table: their names, units, and what they are turned into."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from types import MappingProxyType

# What a column holds, by the names that it may have.
NAMES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "stretch": ("stretch", "stretch ratio", "nominal stretch"),
        "strain": ("strain", "engineering strain", "nominal strain", "tensile strain"),
        "extension": ("extension", "displacement", "elongation"),
        "force": ("force", "load", "standard force"),
        "stress": ("stress", "engineering stress", "nominal stress", "tensile stress"),
        "lateral stretch": ("lateral stretch", "transverse stretch"),
        "lateral strain": ("lateral strain", "transverse strain"),
        "lateral width": ("lateral width", "current width"),
        "specimen": ("specimen", "sample"),
        "direction": ("direction",),
        "width": ("width", "specimen width"),
        "thickness": ("thickness", "specimen thickness"),
        "gauge length": ("gauge length", "specimen length"),
    }
)
ALONG = ("stretch", "strain", "extension")
LOADS = ("force", "stress")
ACROSS = ("lateral stretch", "lateral strain", "lateral width")
# Columns of words; all others are numbers.
WORDS = ("specimen", "direction")
# What may stand once for a whole file, in a line "# width = 25 mm".
CONSTANTS = ("width", "thickness", "gauge length", "specimen", "direction")
# How these look, for messages.
EXAMPLES = MappingProxyType({"width": "25 mm", "thickness": "0.5 mm", "gauge length": "100 mm"})

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "in": 0.0254}
RATIOS = {"": 1.0, "1": 1.0, "-": 1.0, "%": 1e-2, "mm/mm": 1.0, "m/m": 1.0}
FORCES = {"N": 1.0, "mN": 1e-3, "cN": 1e-2, "kN": 1e3}
STRESSES = {
    "Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "N/mm²": 1e6, "N/mm2": 1e6, "N/mm^2": 1e6,
}  # fmt: skip
# A stress of a sheet may come per width; it needs no thickness.
PER_WIDTH = {"N/m": 1.0, "N/mm": 1e3, "N/cm": 1e2, "kN/m": 1e3}
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        **dict.fromkeys(("stretch", "strain", "lateral stretch", "lateral strain"), RATIOS),
        **dict.fromkeys(
            ("extension", "lateral width", "width", "thickness", "gauge length"), LENGTHS
        ),
        "force": FORCES,
        "stress": {**STRESSES, **PER_WIDTH},
    }
)
_HEADER = re.compile(r"\s*(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*")


def split_header(text: str) -> tuple[str, str | None]:
    """Return name and unit of a column's header: "Force [N]" is "force" and "N".

    The unit stands in brackets; None where there is none.
    """
    match = _HEADER.fullmatch(text)
    name, unit = (text, None) if match is None else match.groups()
    return " ".join(name.replace("_", " ").lower().split()), unit


def known_as(name: str) -> str | None:
    """Return what a column of a name holds; None where the name is unknown."""
    for kind, names in NAMES.items():
        if name in names:
            return kind
    return None


def nearest_name(name: str) -> str | None:
    """Return the known name that a name was perhaps meant to be; None where none is near."""
    known = [one for names in NAMES.values() for one in names]
    found = difflib.get_close_matches(name, known, n=1, cutoff=0.8)
    return found[0] if found else None
