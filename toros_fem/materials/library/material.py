"""A material of the library: its values, and where they come from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Annotated

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import In, OneOf, Poisson, Table, key
from toros_fem.base.validation import checked_floats, require_flag, shown
from toros_fem.materials.sheet import STIFFEST, Bladder, Material

# Kinds of materials.
MATERIAL_KINDS = ("fabric", "print", "rubber")
# How far values may be trusted: the words, and what they mean.
TRUSTS: Mapping[str, str] = MappingProxyType(
    {
        "measured": "from a test of this material, whose data the source has",
        "data sheet": "from the maker's data sheet",
        "calibrated": "chosen so that simulations agree with what is published of whole actuators",
        "estimate": "derived from other data, or assumed; the source says how",
    }
)
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}")
# Characters of a title, and of a source or note.
TITLE, TEXT = 60, 600
LARGEST_STRETCH = 20.0


@dataclass(frozen=True)
class MaterialValues(Table):
    """Values of a material as its file holds them; SI units."""

    kind: Annotated[str, OneOf(MATERIAL_KINDS)] = key("fabric", "what it is")
    title: str = key("", "what it is called")
    young: Annotated[float, In("Pa", above=0, at_most=STIFFEST)] = key(
        1.0, "Young's modulus E at small strain"
    )
    poisson: Poisson = key(0.0, "Poisson's ratio ν")
    thickness: Annotated[float, In("m", above=0, at_most=0.05)] = key(1e-3, "thickness")
    c1: Annotated[float, In(above=1, at_most=LARGEST_STRETCH)] | None = key(
        None, "bound on a principal stretch, eq. (1)"
    )
    c2: Annotated[float, In(above=1, at_most=2 * LARGEST_STRETCH)] | None = key(
        None, "bound on the sum of both principal stretches less 1"
    )
    knit_ratio: Annotated[float, In(at_least=1, at_most=100)] | None = key(
        None, "modulus along the courses over that along the wales"
    )
    density: Annotated[float, In("kg/m²", above=0, at_most=100)] | None = key(
        None, "mass per flat area"
    )
    with_fabric: bool = key(
        False, "whether the values are those of a print and its fabric as one sheet"
    )
    trust: Annotated[str, OneOf(tuple(TRUSTS))] = key(
        "estimate", "how far the values may be trusted"
    )
    source: str = key("", "where the values come from")
    note: str | None = key(None, "what else is to be known")


@dataclass(frozen=True, kw_only=True)
class LibraryMaterial:
    """Material of a library.

    Attributes:
        name: Name in scene files: letters, digits, - and _.
        kind: "fabric", "print" or "rubber".
        title: What it is, in some words.
        young: Young's modulus in Pa at small strain; of a knit, along its wales.
        poisson: Poisson's ratio, 0 to 0.5; 0.5 for a rubber.
        thickness: Thickness in m.
        stretch_range: Least and largest stretch within which the values hold; 1 lies between.
        source: Where the values come from: a test, a paper, a data sheet.
        trust: How far they may be trusted, one of `TRUSTS`.
        c1: Bound on a principal stretch, eq. (1); None if it has none of its own.
        c2: Bound on the sum of both less 1; None if it has none of its own.
        knit_ratio: Modulus along the courses over that along the wales; None for no knit.
        density: Mass per flat area in kg/m²; None if it is not known.
        with_fabric: Whether the values of a print are those of print and fabric as one sheet, as
            a pull test of printed fabric gives them; False for the printed layer alone.
        note: What else is to be known; None for nothing.

    Raises:
        ParameterError: A value is out of its bounds, or does not belong to the kind.
    """

    name: str
    kind: str
    title: str
    young: float
    poisson: float
    thickness: float
    stretch_range: tuple[float, float]
    source: str
    trust: str
    c1: float | None = None
    c2: float | None = None
    knit_ratio: float | None = None
    density: float | None = None
    with_fabric: bool = False
    note: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not NAME.fullmatch(self.name) or self.name == "none":
            raise ParameterError(
                f"name = {shown(self.name)} must be letters, digits, - and _, at most 40, and not "
                "'none'.",
                "name",
            )
        require_flag(with_fabric=self.with_fabric)
        names = [entry.name for entry in fields(MaterialValues)]
        values = MaterialValues(**{name: getattr(self, name) for name in names})
        for name in names:  # whole numbers became floats
            object.__setattr__(self, name, getattr(values, name))
        for name, most in (("title", TITLE), ("source", TEXT), ("note", TEXT)):
            self._check_text(name, most)
        self._check_range()
        self._check_kind()

    def _check_text(self, name: str, most: int) -> None:
        text = getattr(self, name)
        if text is not None and not (0 < len(text) <= most and text.isprintable() and text.strip()):
            raise ParameterError(
                f"{name} = {shown(text)} must be one line of 1 to {most} characters.", name
            )

    def _check_range(self) -> None:
        ends = checked_floats("stretch_range", self.stretch_range, "two stretches", (2,))
        low, high = float(ends[0]), float(ends[1])
        if not 0 < low <= 1 < high <= LARGEST_STRETCH:
            raise ParameterError(
                f"stretch_range = [{low:g}, {high:g}] must be a least stretch above 0 and at most "
                f"1, and a largest one above 1 and at most {LARGEST_STRETCH:g}.",
                "stretch_range",
            )
        if self.c1 is not None and high > self.c1:
            raise ParameterError(
                f"stretch_range ends at {high:g}, beyond the bound c1 = {self.c1:g}, which no "
                "stretch reaches. Shorten the range, or raise c1.",
                "stretch_range",
            )
        object.__setattr__(self, "stretch_range", (low, high))

    def _check_kind(self) -> None:
        own = {"knit_ratio": "fabric", "with_fabric": "print"}
        for name, kind in own.items():
            if getattr(self, name) not in (None, False) and self.kind != kind:
                raise ParameterError(
                    f"{name} = {getattr(self, name)} belongs to a {kind}, and this is a "
                    f"{self.kind}. Leave it out.",
                    name,
                )
        if self.kind == "rubber":
            for name in ("c1", "c2"):
                if getattr(self, name) is not None:
                    raise ParameterError(
                        f"{name} = {getattr(self, name)} belongs to eq. (1); a rubber is "
                        "neo-Hookean and has no bounds. Leave it out.",
                        name,
                    )
            if self.poisson != 0.5:
                raise ParameterError(
                    f"poisson = {self.poisson}: a rubber is incompressible here; write 0.5.",
                    "poisson",
                )

    @property
    def material(self) -> Material:
        """Sheet of this material; of a print the printed layer, or print and fabric as one."""
        return Material(self.young, self.poisson, self.thickness, self.c1, self.c2)

    @property
    def bladder(self) -> Bladder:
        """Bladder of this material, which is of its thickness."""
        return Bladder(self.young, self.thickness)

    @property
    def membrane_stiffness(self) -> float:
        """E h in N/m."""
        return self.young * self.thickness
