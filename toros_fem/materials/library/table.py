"""Materials of a library as text: for terminals, and as the tables of the documentation."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from toros_fem.base.units import write_quantity
from toros_fem.materials.library.material import MATERIAL_KINDS, LibraryMaterial

WIDTH = 96
# Heading of each kind.
TITLES: Mapping[str, str] = MappingProxyType(
    {"fabric": "Fabrics", "print": "Prints", "rubber": "Rubbers, for bladders"}
)
HEADER = ("name", "E", "ν", "thickness", "E h", "stretches", "trust")


def table_text(entries: Iterable[LibraryMaterial]) -> str:
    """Return materials as lines for a terminal, by kind, each with its source below."""
    found = list(entries)
    rows = [HEADER, *(_row(entry) for entry in found)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADER))]
    head, *lines = (
        "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    parts: list[str] = []
    for kind in MATERIAL_KINDS:
        of_kind = [k for k, entry in enumerate(found) if entry.kind == kind]
        if of_kind:
            parts += ["", TITLES[kind], head]
        for k in of_kind:
            parts += [lines[k], *_wrapped(f"{found[k].title}. {_sentence(found[k].source)}")]
    return "\n".join(parts[1:])


def material_details(entry: LibraryMaterial) -> str:
    """Return all that is known of a material, as lines for a terminal."""
    low, high = entry.stretch_range
    rows = [
        ("kind", entry.kind),
        ("E", write_quantity(entry.young, "Pa")),
        ("ν", f"{entry.poisson:g}"),
        ("thickness", write_quantity(entry.thickness, "m")),
        ("E h", _stiffness(entry)),
        ("c1", None if entry.c1 is None else f"{entry.c1:g}"),
        ("c2", None if entry.c2 is None else f"{entry.c2:g}"),
        ("knit ratio", None if entry.knit_ratio is None else f"{entry.knit_ratio:g}"),
        ("mass", None if entry.density is None else write_quantity(entry.density, "kg/m²")),
        ("sheet", "print and fabric as one" if entry.with_fabric else None),
        ("stretches", f"{low:g} to {high:g}"),
        ("trust", entry.trust),
        ("source", entry.source),
        ("note", entry.note),
    ]
    lines = [f"{entry.name}: {entry.title}"]
    for name, text in rows:
        if text is not None:
            first, *rest = textwrap.wrap(text, WIDTH - 12)
            lines += [f"{name:12s}{first}", *(f"{'':12s}{line}" for line in rest)]
    return "\n".join(lines)


def table_markdown(entries: Iterable[LibraryMaterial]) -> str:
    """Return materials as tables in Markdown, by kind, with titles and sources below each."""
    found, lines = list(entries), list[str]()
    for kind in MATERIAL_KINDS:
        of_kind = [entry for entry in found if entry.kind == kind]
        if not of_kind:
            continue
        header = tuple("h" if title == "thickness" else title for title in HEADER)
        rows = [header, *(_row(entry) for entry in of_kind)]
        bounds = [_bounds(entry) for entry in of_kind]
        if any(bounds):  # a column before that of the stretches
            cells = ["c₁, c₂", *bounds]
            rows = [(*r[:-2], c, *r[-2:]) for r, c in zip(rows, cells, strict=True)]
        table = [f"| {' | '.join(row)} |" for row in rows]
        lines += [f"**{TITLES[kind]}**", "", table[0], f"|{len(rows[0]) * '---|'}", *table[1:], ""]
        lines += [line for entry in of_kind for line in _markdown_source(entry)]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _row(entry: LibraryMaterial) -> tuple[str, ...]:
    low, high = entry.stretch_range
    return (
        entry.name,
        write_quantity(entry.young, "Pa"),
        f"{entry.poisson:g}",
        write_quantity(entry.thickness, "m"),
        _stiffness(entry),
        f"{low:g} to {high:g}",
        entry.trust,
    )


def _bounds(entry: LibraryMaterial) -> str:
    bounds = [f"{c:g}" if c is not None else "–" for c in (entry.c1, entry.c2)]
    return "" if bounds == ["–", "–"] else ", ".join(bounds)


def _markdown_source(entry: LibraryMaterial) -> list[str]:
    text = f"`{entry.name}`, {entry.title}. {_sentence(entry.source)}"
    if entry.knit_ratio is not None:
        text += f" Modulus along the courses over that along the wales: {entry.knit_ratio:g}."
    if entry.note is not None:
        text += f" {_sentence(entry.note)}"
    text = text.replace(" %", "\u00a0%")  # a line that begins with % is a comment
    return textwrap.wrap(
        text, 118, initial_indent="- ", subsequent_indent="  ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip


def _stiffness(entry: LibraryMaterial) -> str:
    value = entry.membrane_stiffness
    return f"{value / 1e3:.3g} kN/m" if value >= 1e3 else f"{value:.3g} N/m"


def _wrapped(text: str) -> list[str]:
    return [f"    {line}" for line in textwrap.wrap(text, WIDTH - 4, break_on_hyphens=False)]


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:].rstrip('.')}."
