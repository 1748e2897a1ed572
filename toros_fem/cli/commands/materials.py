"""`toros materials`: the library of fabrics, prints and rubbers, by name."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import File, OneOf, Text, key
from toros_fem.base.units import write_quantity
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.materials.library.files import named, read_library
from toros_fem.materials.library.material import MATERIAL_KINDS, LibraryMaterial

WIDTH = 96
# Heading of each kind.
TITLES: Mapping[str, str] = MappingProxyType(
    {"fabric": "Fabrics", "print": "Prints", "rubber": "Rubbers, for bladders"}
)
HEADER = ("name", "E", "ν", "thickness", "E h", "stretches", "trust")


class Materials(Command, kw_only=True):
    """Lists materials that scenes know by name.

    Each has its modulus, thickness, range of stretches, trust and source. Scenes name them:
    fabric = "jersey-light", reinforcement = "tpu-95a", bladder = "dragon-skin-20".
    """

    name: Text | None = key(None, "show all of this material; none: a table of all")
    file: tuple[File, ...] = key(
        (),
        "file of materials of your own, over the shipped ones; may be given several times",
    )
    kind: Annotated[str, OneOf(MATERIAL_KINDS)] | None = key(None, "only this kind; none: all")

    WORDS: ClassVar = ("name",)
    TAKES: ClassVar = {"file": "FILE", "kind": "KIND"}
    EXAMPLES: ClassVar = (
        "toros materials",
        "toros materials tpu-95a",
        "toros materials --kind rubber --file my_materials.toml --json",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Read and tell them (collective)."""
        library = read_library(*self.file, comm=comm)
        if self.name is not None:
            entry = named(library, self.name, self.kind)
            return Answer(material_details(entry), entry.as_dict())
        found = [entry for entry in library.values() if self.kind in (None, entry.kind)]
        return Answer(table_text(found), {"materials": [entry.as_dict() for entry in found]})


def table_text(entries: Iterable[LibraryMaterial]) -> str:
    """Return materials as lines for a terminal, by kind, each with its source below."""
    found, gap = list(entries), 4 * " "
    widths = [max(map(len, cells)) for cells in zip(HEADER, *map(row, found), strict=True)]

    def line(cells: Sequence[str]) -> str:
        return "  ".join(map(str.ljust, cells, widths)).rstrip()

    lines: list[str] = []
    for kind in MATERIAL_KINDS:
        of_kind = [entry for entry in found if entry.kind == kind]
        lines += ["", TITLES[kind], line(HEADER)] if of_kind else []
        for entry in of_kind:
            text = f"{entry.title}. {sentence(entry.source)}"
            below = textwrap.wrap(
                text, WIDTH, initial_indent=gap, subsequent_indent=gap, break_on_hyphens=False
            )
            lines += [line(row(entry)), *below]
    return "\n".join(lines[1:])


def material_details(entry: LibraryMaterial) -> str:
    """Return all that is known of a material, as lines for a terminal."""
    lines, gap = [f"{entry.name}: {entry.title}"], 12 * " "
    for label, text in _cells(entry).items():
        if label != "name":
            head = label.ljust(len(gap))
            lines += textwrap.wrap(text, WIDTH, initial_indent=head, subsequent_indent=gap)
    return "\n".join(lines)


def row(entry: LibraryMaterial) -> list[str]:
    """Return the cells of a material below `HEADER`."""
    return [_cells(entry)[label] for label in HEADER]


def sentence(text: str) -> str:
    """Return a text with a capital letter and a full stop."""
    return f"{text[0].upper()}{text[1:].rstrip('.')}."


def _cells(entry: LibraryMaterial) -> dict[str, str]:
    """Return what is known of a material, by its label."""
    (low, high), stiffness = entry.stretch_range, entry.membrane_stiffness
    thousands, unit = (1e3, "kN/m") if stiffness >= 1e3 else (1.0, "N/m")
    cells = {
        "name": entry.name,
        "kind": entry.kind,
        "E": write_quantity(entry.young, "Pa"),
        "ν": f"{entry.poisson:g}",
        "thickness": write_quantity(entry.thickness, "m"),
        "E h": f"{stiffness / thousands:.3g} {unit}",
        "c1": entry.c1 and f"{entry.c1:g}",
        "c2": entry.c2 and f"{entry.c2:g}",
        "knit ratio": entry.knit_ratio and f"{entry.knit_ratio:g}",
        "mass": entry.density and write_quantity(entry.density, "kg/m²"),
        "sheet": entry.with_fabric and "print and fabric as one",
        "stretches": f"{low:g} to {high:g}",
        "trust": entry.trust,
        "source": entry.source,
        "note": entry.note,
    }
    return {label: str(text) for label, text in cells.items() if text}
