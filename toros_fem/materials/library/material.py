"""A material of the library: its values, and where they come from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING
from types import MappingProxyType
from typing import Annotated

from toros_fem.base.keys import Flag, In, OneOf, Poisson, Real, Table, Text, key
from toros_fem.materials.sheet import STIFFEST, Bladder, Material

# Kinds of materials.
MATERIAL_KINDS = ("fabric", "print", "rubber")
# How far values may be trusted: the words, and what they mean.
TRUSTS: Mapping[str, str] = MappingProxyType(
    {
        "measured": "from a test of this material, whose data the source has",
        "doubted": "from a test whose origin, fit or scatter may move the values; see its note",
        "data sheet": "from the maker's data sheet",
        "calibrated": "chosen so that simulations agree with what is published of whole actuators",
        "estimate": "derived from other data, or assumed; the source says how",
    }
)
# Threads of a fabric, beside the isotropic sheet.
THREADS = (
    "course_stiffness", "course_strain", "wale_stiffness", "wale_strain", "shear_stiffness",
)  # fmt: skip
NAME = re.compile(r"(?!none$)[A-Za-z0-9][A-Za-z0-9_-]{0,39}")
# Most characters of texts, which are one line each.
LENGTHS = {"title": 60, "source": 600, "note": 600}
# Ends of a range of stretches.
LEAST, LARGEST = In(above=0, at_most=1), In(above=1, at_most=20)


class LibraryMaterial(Table, kw_only=True):
    """Material of a library; SI units.

    Raises:
        ParameterError: A value is out of its bounds, or does not belong to the kind.
    """

    name: Text = key(MISSING, "name in scene files, of letters, digits, - and _")
    kind: Annotated[str, OneOf(MATERIAL_KINDS)] = key(MISSING, "what it is")
    title: Text = key(MISSING, "what it is called, in some words")
    young: Annotated[float, In("Pa", above=0, at_most=STIFFEST)] = key(
        MISSING, "Young's modulus at small strain; of a knit, along its wales"
    )
    poisson: Poisson = key(MISSING, "Poisson's ratio; 0.5 for a rubber")
    thickness: Annotated[float, In("m", above=0, at_most=0.05)] = key(MISSING, "thickness")
    c1: Annotated[float, LARGEST] | None = key(
        None, "bound on a principal stretch, eq. (1); none if it has none of its own"
    )
    c2: Annotated[float, In(above=1, at_most=40)] | None = key(
        None, "bound on the sum of both less 1; none if it has none of its own"
    )
    knit_ratio: Annotated[float, In(at_least=1, at_most=100)] | None = key(
        None, "modulus along the courses over that along the wales; none for no knit"
    )
    course_stiffness: Annotated[float, In("N/m", at_least=0)] | None = key(
        None, "stiffness of threads along the courses, in the place of knit_ratio; none for none"
    )
    course_strain: Annotated[float, In(above=0, at_most=100)] | None = key(
        None, "strain over which they stiffen; none: they do not"
    )
    wale_stiffness: Annotated[float, In("N/m", at_least=0)] | None = key(
        None, "stiffness of threads along the wales; none for none"
    )
    wale_strain: Annotated[float, In(above=0, at_most=100)] | None = key(
        None, "strain over which they stiffen; none: they do not"
    )
    shear_stiffness: Annotated[float, In("N/m", at_least=0)] | None = key(
        None, "stiffness against shear of the threads; none for none"
    )
    second: Annotated[float, In("Pa")] | None = key(
        None, "constant C₂₀ of Yeoh's law of a rubber; none for a neo-Hookean one"
    )
    third: Annotated[float, In("Pa", at_least=0)] | None = key(
        None, "constant C₃₀ of Yeoh's law of a rubber; none for none"
    )
    density: Annotated[float, In("kg/m²", above=0, at_most=100)] | None = key(
        None, "mass per flat area; none if it is not known"
    )
    with_fabric: Flag = key(
        False,
        "whether the values of a print are those of print and fabric as one sheet, as a pull test "
        "of printed fabric gives them, and not of the printed layer alone",
    )
    stretch_range: tuple[Real, Real] = key(
        MISSING, "least and largest stretch within which the values hold; 1 lies between"
    )
    trust: Annotated[str, OneOf(tuple(TRUSTS))] = key(MISSING, "how far values may be trusted")
    source: Text = key(MISSING, "where the values come from: a test, a paper, a data sheet")
    note: Text | None = key(None, "what else is to be known; none for nothing")

    def __post_init__(self) -> None:
        for name, right, why in self._rules():
            if not right:
                raise self.described()[name].refusal(getattr(self, name), why)

    @property
    def tested_stretch(self) -> float:
        """Largest stretch for which the values hold."""
        return self.stretch_range[1]

    def _rules(self) -> Iterator[tuple[str, object, str]]:
        """Yield what must hold beside the bounds: of which key, whether it does, and its words."""
        letters = "must be letters, digits, - and _, at most 40, and not 'none'"
        yield "name", NAME.fullmatch(self.name), letters
        for name, most in LENGTHS.items():
            text = getattr(self, name)
            fits = text is None or (len(text) <= most and text.isprintable() and text.strip())
            yield name, fits, f"must be one line of 1 to {most} characters"
        (low, high), bound, rubber = self.stretch_range, self.c1, self.kind == "rubber"
        ends = f"must be a least stretch {LEAST} and a largest one {LARGEST}"
        yield "stretch_range", low in LEAST and high in LARGEST, ends
        beyond = f"ends beyond c1 = {bound}, which no stretch reaches. Shorten it, or raise c1"
        yield "stretch_range", bound is None or high <= bound, beyond
        threads = dict.fromkeys(("knit_ratio", *THREADS), "fabric")
        rubbers = {"second": "rubber", "third": "rubber"}
        for name, kind in {**threads, **rubbers, "with_fabric": "print"}.items():
            other = f"belongs to a {kind}, and this is a {self.kind}. Leave it out"
            yield name, not getattr(self, name) or self.kind == kind, other
        neo = "belongs to eq. (1); a rubber has no bounds. Leave it out"
        yield "c1", not rubber or bound is None, neo
        yield "c2", not rubber or self.c2 is None, neo
        fluid = "must be 0.5: a rubber is incompressible here"
        yield "poisson", not rubber or self.poisson == 0.5, fluid

    @property
    def material(self) -> Material:
        """Sheet of this material; of a print the printed layer, or print and fabric as one."""
        return Material(self.young, self.poisson, self.thickness, self.c1, self.c2)

    @property
    def bladder(self) -> Bladder:
        """Bladder of this material, which is of its thickness."""
        return Bladder(self.young, self.thickness, self.second, self.third)

    @property
    def membrane_stiffness(self) -> float:
        """E h in N/m."""
        return self.young * self.thickness
