"""Libraries of materials, read strictly: a wrong key or value is told with file and line."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.errors import LibraryError, ParameterError
from toros_fem.base.keys import nearest
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.toml_files.document import Document, read_text
from toros_fem.base.validation import checked_path
from toros_fem.materials.library.material import LibraryMaterial, MaterialValues

SHIPPED = "materials.toml"
RANGE = "stretch_range"
# Keys that each entry needs, and all keys, in the order of writing.
NEEDED = ("kind", "title", "young", "poisson", "thickness", RANGE, "trust", "source")
KEYS = (
    "kind", "title", "young", "poisson", "thickness", "c1", "c2", "knit_ratio", "density",
    "with_fabric", RANGE, "trust", "source", "note",
)  # fmt: skip


def read_library(*paths: str | Path, comm: MPI.Comm | None = None) -> Mapping[str, LibraryMaterial]:
    """Return the shipped materials by name, and those of other files over them.

    Args:
        paths: Files of one's own; a material of the same name replaces an earlier one.
        comm: Communicator whose first rank reads, for all of them (collective); None: each rank
            reads, or the only one.

    Raises:
        LibraryError: A file cannot be read, or a key or value is wrong; with file, line and key.
            It is raised on all ranks.
    """
    places = [checked_path("path", path, LibraryError) for path in paths]

    def read() -> dict[str, LibraryMaterial]:
        with as_file(files(__package__) / SHIPPED) as shipped:
            found = read_materials(shipped)
        for path in places:
            found |= read_materials(path)
        return found

    return read() if comm is None else on_first_rank(comm, read)


def read_materials(path: Path) -> dict[str, LibraryMaterial]:
    """Return the materials of one file by name, in its order.

    Raises:
        LibraryError: As of `read_library`.
    """
    return materials_of(path, read_text(path, "a file of materials", LibraryError))


def materials_of(path: Path, text: str) -> dict[str, LibraryMaterial]:
    """Return the materials of the text of a file.

    Raises:
        LibraryError: As of `read_library`; it names this path.
    """
    document = Document(path, text, LibraryError)
    return {name: _entry(document, name, values) for name, values in document.content.items()}


def named(
    library: Mapping[str, LibraryMaterial], name: str, kind: str | None = None
) -> LibraryMaterial:
    """Return a material of a library.

    Args:
        library: The materials by name.
        name: Name of the material.
        kind: The kind that is asked for; None for any.

    Raises:
        LibraryError: There is none of this name; the nearest one is named. Or it is of another
            kind.
    """
    of_kind = [key for key, entry in library.items() if kind in (None, entry.kind)]
    if name not in library:
        what = "material" if kind is None else kind
        raise LibraryError(
            f"{name!r} is no {what} of the library; {nearest(name, of_kind)} `toros materials` "
            "lists all."
        )
    found = library[name]
    if kind not in (None, found.kind):
        raise LibraryError(
            f"{name!r} is a {found.kind}, and a {kind} is asked for; known are "
            f"{', '.join(of_kind) or 'none'}."
        )
    return found


def _entry(document: Document, name: str, values: Any) -> LibraryMaterial:
    if not isinstance(values, dict):
        document.fail((name,), f"must be a table: write [{name}], and its keys in lines below.")
    for key in values:
        if key not in KEYS:
            document.fail((name, key), f"unknown key {key!r}; {nearest(key, KEYS)}")
    given: dict[str, Any] = {}
    for key, value in values.items():
        try:
            if key == RANGE:
                given[key] = _range(value)
            else:
                given[key] = MaterialValues.described()[key].read(value)
        except ParameterError as caught:
            document.fail((name, key), str(caught))
    missing = [key for key in NEEDED if key not in given]
    if missing:
        document.fail((name,), f"it has no {', '.join(missing)}.")
    try:
        return LibraryMaterial(name=name, **given)
    except ParameterError as caught:
        document.fail((name, caught.key or "") if caught.key in values else (name,), str(caught))


def _range(value: Any) -> tuple[float, float]:
    numbers = isinstance(value, list) and [
        isinstance(end, int | float) and not isinstance(end, bool) for end in value
    ]
    if numbers != [True, True]:
        raise ParameterError("must be two stretches, as numbers: [1.0, 1.5] for instance.")
    try:
        return float(value[0]), float(value[1])
    except OverflowError:
        raise ParameterError("the number is too large.") from None
