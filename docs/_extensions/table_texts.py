"""Tables in Markdown that the site makes from code and from committed rows."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

from toros_fem.base.scene import Scene
from toros_fem.cli.commands.materials import HEADER, TITLES, row, sentence
from toros_fem.cli.scene_files.layout import keys_of
from toros_fem.materials.library.files import read_library
from toros_fem.materials.library.material import MATERIAL_KINDS, TRUSTS, LibraryMaterial
from toros_fem.products.kinds import ABOUT, KINDS
from toros_fem.products.plausibility import RANGES


def table_of(name: str) -> list[str]:
    """Return the lines of a table: scene-keys, usual-ranges, materials or accuracy-cases."""
    if name == "scene-keys":
        return [line for kind in KINDS.values() for line in page_of(kind)]
    if name == "usual-ranges":
        return usual_ranges()
    if name == "materials":
        return materials(read_library().values())
    if name == "accuracy-cases":
        from benchmarks.accuracy.command import sections
        from benchmarks.bench import ROWS, read

        return sections(read(ROWS / "accuracy.csv")).splitlines()
    raise ValueError(f"no table has the name {name!r}.")


def page_of(kind: type[Scene]) -> list[str]:
    """Return heading and tables of a kind in Markdown."""
    lines = [f"## {kind.KIND}", "", f"{ABOUT[kind.KIND][0].upper()}{ABOUT[kind.KIND][1:]}.", ""]
    scene, keys = kind(), keys_of(kind)
    for section, of in kind.tables().items():
        lines += [f"**[{section}]** {of.holds()}", "", "| key | meaning | default |"]
        lines.append("|---|---|---|")
        for key, one in keys[section].items():
            value = scene.value(key) if key in of.described() else one.default
            default = one.written(value).strip('"').replace(" ", "&nbsp;")
            lines.append(f"| `{key}` | {one.help.replace('|', '&#124;')} | {default} |")
        lines.append("")
    for name, of in kind.entries().items():
        lines += [f"**[{name}]** {of.holds()}; may stand several times", "", "| key | meaning |"]
        lines += [
            "|---|---|",
            *(f"| `{key}` | {one.help} |" for key, one in of.described().items()),
            "",
        ]
    return lines


def usual_ranges() -> list[str]:
    """Return the table of dimensionless groups."""
    lines = ["| group | usual | refused outside of | source |", "|---|---|---|---|"]
    for name, one in RANGES.items():
        usual, possible = (f"{low:g} to {high:g}" for low, high in (one.usual, one.possible))
        lines.append(f"| {name}: {one.words} | {usual} | {possible} | {one.source} |")
    return [line.replace("-inf", "−∞").replace("inf", "∞") for line in lines]


def materials(entries: Iterable[LibraryMaterial]) -> list[str]:
    """Return tables of materials per kind, with titles and sources below each."""
    found = list(entries)
    lines = ["| source quality | meaning |", "|---|---|"]
    lines += [*(f"| {word} | {meaning} |" for word, meaning in TRUSTS.items()), ""]
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
    return lines


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
