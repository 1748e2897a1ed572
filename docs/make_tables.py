"""Make the tables of the docs that come from code, in Markdown that any reader shows.

    python3 docs/make_tables.py

A test compares them with the code.
"""

from __future__ import annotations

import csv
import inspect
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

import toros_fem
from toros_fem.cli.commands.materials import HEADER, row, sentence
from toros_fem.cli.scene_files import FILES, POSE, keys_of
from toros_fem.materials.library.files import read_library
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.products.common.plausibility import RANGES
from toros_fem.products.kinds import KINDS

DOCS = Path(__file__).resolve().parent
Rows = Iterable[Sequence[str]]


def scene_keys() -> Rows:
    """Yield each key of scene files once, with the scenes that have it."""
    found: dict[tuple[str, ...], list[str]] = {}
    for kind in KINDS.values():
        scene, quick, keys = kind(), kind().coarse(), keys_of(kind)
        for section, of in kind.tables().items():
            for key, one in keys[section].items():
                values = [one.default, one.default]
                if key in of.described():
                    values = [scene.value(key), quick.value(key)]
                default, coarse = (one.written(value).strip('"') for value in values)
                entry = (f"[{section}]", key, one.help, default, coarse * (coarse != default))
                found.setdefault(entry, []).append(kind.KIND)
        for key, one in keys[FILES].items():
            found.setdefault((f"[{FILES}]", key, one.help, "", ""), []).append(kind.KIND)
        for section, of in kind.entries().items():
            for key, one in of.described().items():
                found.setdefault((f"[[{section}]]", key, one.help, "", ""), []).append(kind.KIND)
        own = {key: one for key, one in kind.pose_keys().items() if key not in kind.described()}
        for key, one in own.items():
            found.setdefault((f"[[{POSE}]]", key, one.help, "", ""), []).append(kind.KIND)
    yield "table", "key", "meaning", "default", "by --coarse", "scenes"
    order = list(dict.fromkeys(entry[0] for entry in found))
    for entry, kinds in sorted(found.items(), key=lambda item: order.index(item[0][0])):
        yield *entry, ", ".join(kinds)


def usual_ranges() -> Rows:
    """Yield the dimensionless groups that scenes are judged by."""
    yield "group", "meaning", "usual", "refused outside of", "source"
    for name, one in RANGES.items():
        usual, possible = (
            f"{low:g} to {high:g}".replace("inf", "∞").replace("-", "−")
            for low, high in (one.usual, one.possible)
        )
        yield name, one.words, usual, possible, one.source


def materials() -> Rows:
    """Yield the materials of the library."""
    yield "kind", *HEADER, "c₁, c₂", "what it is, and its source"
    for entry in read_library().values():
        yield entry.kind, *row(entry), bounds_of(entry), source_of(entry)


def bounds_of(entry: LibraryMaterial) -> str:
    """Return the cell of c₁ and c₂; empty without both."""
    bounds = [f"{c:g}" if c is not None else "–" for c in (entry.c1, entry.c2)]
    return "" if bounds == ["–", "–"] else ", ".join(bounds)


def source_of(entry: LibraryMaterial) -> str:
    """Return title, source and note."""
    text = f"{entry.title}. {sentence(entry.source)}"
    if entry.knit_ratio is not None:
        text += f" Modulus along the courses over that along the wales: {entry.knit_ratio:g}."
    for name in ("course", "wale"):
        stiffness, strain = getattr(entry, f"{name}_stiffness"), getattr(entry, f"{name}_strain")
        if stiffness is not None:
            stiffens = "" if strain is None else f" over a strain of {strain:.3g}"
            text += f" Threads along the {name}s: {stiffness:.3g} N/m{stiffens}."
    return text if entry.note is None else f"{text} {sentence(entry.note)}"


def names() -> Rows:
    """Yield the names of the package with the first sentence of their descriptions."""
    yield "name", "what it is or does"
    for name in toros_fem.public.__all__:
        thing = getattr(toros_fem, name)
        if callable(thing):
            yield name, (inspect.getdoc(thing) or "").partition("\n")[0]


def csv_file(path: Path) -> Rows:
    """Yield the rows of a file."""
    with path.open(encoding="utf-8", newline="") as file:
        yield from csv.reader(file)


RESULTS = DOCS.parent / "toros_fem" / "results"
# Tables by the mark at their place: the page, the rows, and the columns of names.
TABLES: dict[str, tuple[str, Callable[[], Rows], tuple[int, ...]]] = {
    "keys of scenes": ("reference/scene_keys.md", scene_keys, (0, 1)),
    "usual ranges": ("reference/scene_keys.md", usual_ranges, ()),
    "materials": ("materials.md", materials, (1,)),
    "names": ("reference/index.md", names, (0,)),
    "columns": ("reference/columns.md", partial(csv_file, RESULTS / "columns.csv"), (0, 2)),
    "files": ("reference/files.md", partial(csv_file, RESULTS / "files.csv"), (0,)),
    "limits": ("limits.md", partial(csv_file, DOCS / "limits.csv"), ()),
}


def markdown(rows: Rows, code: Sequence[int]) -> str:
    """Return rows as a table of Markdown, the first one its head; some columns hold names."""
    lines = []
    for number, texts in enumerate(rows):
        cells = [" ".join(text.split()).replace("|", r"\|") for text in texts]
        if number:
            cells = [f"`{c}`" if k in code and c else c for k, c in enumerate(cells)]
        lines.append(f"| {' | '.join(cells)} |")
        lines += ["|" + "---|" * len(cells)] if number == 0 else []
    return "\n".join(lines)


def pages() -> dict[Path, str]:
    """Return the text of each page with its tables."""
    found: dict[Path, str] = {}
    for mark, (page, rows, code) in TABLES.items():
        path = DOCS / page
        text = found.get(path) or path.read_text(encoding="utf-8")
        head, begin, rest = text.partition(f"<!-- {mark} -->\n")
        _, end, tail = rest.partition(f"<!-- end of {mark} -->\n")
        if not begin or not end:
            raise SystemExit(f"{path} has no place for the table {mark!r}")
        found[path] = f"{head}{begin}\n{markdown(rows(), code)}\n\n{end}{tail}"
    return found


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
