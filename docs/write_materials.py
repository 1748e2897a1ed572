"""Writes the tables of docs/materials.md, from the library of materials."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from pathlib import Path

from toros_fem.materials.library.files import read_library
from toros_fem.materials.library.material import MATERIAL_KINDS, LibraryMaterial
from toros_fem.materials.library.table import HEADER, TITLES, row, sentence

PAGE = Path(__file__).parent / "materials.md"
BEGIN = "<!-- tables of the library, by docs/write_materials.py; do not edit -->\n"
END = "<!-- end of the tables -->\n"


def page_text(text: str) -> str:
    """Return the page with the tables of the shipped library."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{tables(read_library().values())}\n{END}{after}"


def tables(entries: Iterable[LibraryMaterial]) -> str:
    """Return materials as tables in Markdown, by kind, with titles and sources below each."""
    found, lines = list(entries), list[str]()
    for kind in MATERIAL_KINDS:
        of_kind = [entry for entry in found if entry.kind == kind]
        header = tuple("h" if title == "thickness" else title for title in HEADER)
        rows = [header, *(row(entry) for entry in of_kind)]
        bounds = [bounds_of(entry) for entry in of_kind]
        if any(bounds):  # a column before that of the stretches
            cells = ["c₁, c₂", *bounds]
            rows = [(*r[:-2], c, *r[-2:]) for r, c in zip(rows, cells, strict=True)]
        table = [f"| {' | '.join(row)} |" for row in rows]
        lines += [f"**{TITLES[kind]}**", "", table[0], f"|{len(rows[0]) * '---|'}", *table[1:], ""]
        lines += [line for entry in of_kind for line in source_of(entry)]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def bounds_of(entry: LibraryMaterial) -> str:
    """Return the cell of c₁ and c₂; empty without both."""
    bounds = [f"{c:g}" if c is not None else "–" for c in (entry.c1, entry.c2)]
    return "" if bounds == ["–", "–"] else ", ".join(bounds)


def source_of(entry: LibraryMaterial) -> list[str]:
    """Return the lines of a list's item: title, source and note."""
    text = f"`{entry.name}`, {entry.title}. {sentence(entry.source)}"
    if entry.knit_ratio is not None:
        text += f" Modulus along the courses over that along the wales: {entry.knit_ratio:g}."
    if entry.note is not None:
        text += f" {sentence(entry.note)}"
    text = text.replace(" %", "\u00a0%")  # a line that begins with % is a comment
    return textwrap.wrap(
        text, 118, initial_indent="- ", subsequent_indent="  ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


if __name__ == "__main__":
    PAGE.write_text(page_text(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
