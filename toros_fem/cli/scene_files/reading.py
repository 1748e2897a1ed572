"""Scene files, read strictly: a wrong key or value is told with file, line and remedy."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.errors import FileError, OutlineError, ParameterError
from toros_fem.base.keys import Table, meant, nearest, plain_value
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.scene import Scene
from toros_fem.base.toml_file import Document, Place, at, read_text
from toros_fem.base.validation import shown
from toros_fem.cli.scene_files.layout import FILES, LIBRARY, QUICK, file_type, keys_of
from toros_fem.cli.scene_files.materials import KIND_OF, numbers_of
from toros_fem.materials.library.files import named, read_library
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.products.kinds import KINDS

# Stands for the table of keys that the command line changes.
CHANGED = "--set"
# Keys that a message names: with a value, or of several words.
KEYS_IN_MESSAGE = re.compile(r"\b(\w+(?= = )|[a-z0-9]+_\w+)")


@dataclass(frozen=True)
class SceneFile:
    """A scene that was read.

    Attributes:
        files: Files and folders that it names, by name, absolute or relative to the current folder.
        lines: Line of each key and of each of these, "files.mesh", in the file; none where the
            command line gives it.
        materials: Materials of the library that it names, by "fabric", "reinforcement" and
            "bladder"; numbers that are given beside a name beat those of the material.
        instead: Values of the file in whose place the quick variant, if it was taken, has others.
    """

    path: Path
    kind: type[Scene]
    config: Scene
    files: Mapping[str, Path]
    lines: Mapping[str, int]
    materials: Mapping[str, LibraryMaterial]
    instead: Mapping[str, Any] = field(default_factory=dict)

    def require_files(self, comm: MPI.Comm) -> None:
        """Check that the files and folders that it names are there (collective).

        Raises:
            FileError: One is not; with file, line and key. It is raised on all ranks.
        """
        missing = on_first_rank(
            comm, lambda: [name for name, path in self.files.items() if not path.exists()]
        )
        for name in missing:
            line = self.lines.get(f"files.{name}")
            place = "" if line is None else f"{at(self.path, line)}: "
            raise FileError(
                f"{place}files.{name}: there is no {self.files[name]}. Paths in a scene file are "
                "relative to it, those of the command line to the current folder.",
                self.path,
                line,
                f"files.{name}",
            )

    @contextlib.contextmanager
    def located(self) -> Iterator[None]:
        """Tell file and line of the key that an error in the block names, by a FileError."""
        try:
            yield
        except (ParameterError, OutlineError) as caught:
            text, key = str(caught), getattr(caught, "key", None)
            words = self.kind.OUTLINE if isinstance(caught, OutlineError) else {}
            for word, own in words.items():
                text = re.sub(rf"\b{word}\b", own, text)
            key = next((one for one in _named(text, key) if one in self.lines), key)
            line = self.lines.get(str(key))
            message = f"{at(self.path, line)}: {text}"
            raise FileError(message, self.path, line, key) from None


def read_scene(
    path: str | Path,
    *,
    comm: MPI.Comm | None = None,
    coarse: bool = False,
    changes: Sequence[str] = (),
) -> SceneFile:
    """Read a scene file.

    Paths in it are relative to the file. `SceneFile.require_files` checks whether they exist.

    Args:
        path: The file, in TOML.
        comm: Communicator whose first rank reads, for all of them (collective); None: each rank
            reads, or the only one.
        coarse: Whether to take the quick variant, with the table `coarse` of the file.
        changes: Texts "KEY=VALUE" that override the file and the quick variant. The key may come
            with its table: "design.seed=3". Paths are relative to the current folder.

    Raises:
        FileError: The file cannot be read, is no TOML, or a key or value is wrong; with file, line,
            key and remedy. It is raised on all ranks. So is its file of materials.
    """
    path = Path(path)

    def text() -> str:
        return read_text(path, "a scene file")

    found = text() if comm is None else on_first_rank(comm, text)
    return _Reader(path, found).scene(comm, coarse, changes)


# Values by their keys.
_Values = dict[str, Any]


def _named(message: str, key: str | None) -> list[str]:
    """Return the keys that an error is about: the one that it knows, then those that it names."""
    return [str(key), *KEYS_IN_MESSAGE.findall(message)]


class _Reader(Document):
    """One scene file, while it is read.

    Attributes:
        keys: Keys of each table.
        homes: The table of each key of the scene.
        changes: Changes of the command line, by the place of the content that they were put to.
        over: Values of keys of the scene that the command line gives.
    """

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(path, text)
        self.changes: dict[Place, str] = {}
        self.over = _Values()
        name = self.content.get("kind")
        if name is None:
            known = ", ".join(KINDS)
            self.fail((), f'it names no kind. Begin with kind = "bend", or one of {known}.')
        if not isinstance(name, str) or name not in KINDS:
            self.fail(("kind",), f"{name!r} is no kind; {nearest(name, KINDS)}")
        self.kind = KINDS[name]
        self.keys = keys_of(self.kind)
        once = self.kind.tables()
        self.homes = {key: table for table in once for key in self.keys[table]}

    def failed(self, place: Place, message: str) -> FileError:
        """Return the error of a key of the file, or of a change."""
        change = self.changes.get((*place[:1], *place[-1:]))
        if change is not None:
            return FileError(f"change {shown(change)}: {message}", key=str(place[-1]))
        return super().failed(place, message)

    def scene(self, comm: MPI.Comm | None, coarse: bool, changes: Sequence[str]) -> SceneFile:
        """Return the scene, with changes that stand over the file and its quick variant."""
        for text in changes:
            self.change(text)
        content = self.values(file_type(self.kind), self.keys)
        files, quick = content.pop(FILES, {}), content.pop(QUICK, {})
        for name, path in files.items():
            if path is not None and (FILES, name) not in self.changes:
                files[name] = self.path.parent / path
        given = {
            key: content[at][key] for key, at in self.homes.items() if key in content.get(at, ())
        }
        given |= {name: self.rows(name, of, content) for name, of in self.kind.entries().items()}

        own = files.pop(LIBRARY, None)
        if LIBRARY in self.keys[FILES]:
            library = read_library(*([] if own is None else [own]), comm=comm)
            for table, values in (("", given), (QUICK, quick), (CHANGED, self.over)):
                self.name_materials(table, values, library)
        layers, instead = [("", given)], dict[str, Any]()
        if coarse:
            plain, _ = self.resolved(layers)
            coarser = _coarser(plain)
            layers += [("", coarser), (QUICK, quick)]
            known = (coarser.keys() | quick.keys()) & plain.described().keys() - self.over.keys()
            instead = {key: plain.value(key) for key in plain.described() if key in known}
        config, materials = self.resolved([*layers, (CHANGED, self.over)])
        files = {name: path for name, path in files.items() if path is not None}
        lines = {
            f"{FILES}.{place[1]}" if place[0] == FILES else str(place[-1]): line
            for place, line in self.lines.items()
            if len(place) == 2 and place not in self.changes and place[1] not in self.over
        }
        return SceneFile(self.path, self.kind, config, files, lines, materials, instead)

    def change(self, text: str) -> None:
        """Take a change TABLE.KEY=VALUE, whose table may be missing."""
        name, equals, value = text.partition("=")
        table, _, key = name.strip().rpartition(".")
        if not equals or not key:
            advice = "write KEY=VALUE, design.seed=3 for instance."
            raise FileError(f"change {shown(text)}: {advice}", key=key)
        entries = self.kind.entries()
        apart = table == FILES or table in entries
        at: Place = (table if apart else CHANGED, key)
        self.changes[at] = text
        known = [one for one in self.keys if one != QUICK]
        if table and table not in known:
            self.fail(at, f"unknown table {shown(table)}; {nearest(table, known)}")
        if apart:
            home = self.content.setdefault(table, {})
            if isinstance(home, list):
                if len(home) != 1:
                    self.fail(at, f"the file has {len(home)} tables {table}; edit it.")
                home = home[0]
            if isinstance(home, dict):  # otherwise the table is refused
                home[key] = plain_value(value)
            return
        own = self.keys[table or QUICK]
        if key not in own:
            self.fail(at, self.unknown(at, "key", own))
        try:
            self.over[key] = own[key].read(plain_value(value))
        except ParameterError as caught:
            self.fail(at, str(caught))

    def advice(self, place: Place, name: str, known: Collection[str]) -> str:
        """Return the nearest known word, or the table in which a key stands."""
        apart = place[0] == FILES or place[0] in self.kind.entries()
        homes = {} if apart else self.homes
        if name in homes:
            return f"it stands in the table [{homes[name]}]."
        if place[0] == CHANGED and name in self.keys[FILES]:
            return f"write {FILES}.{name}."
        far = meant(name, homes)
        if far is not None and meant(name, known) is None:
            return f"did you mean {far!r}, in the table [{homes[far]}]?"
        return nearest(name, known)

    def rows(self, name: str, of: type[Table], content: _Values) -> list[Table]:
        """Return the tables of a name, which may stand several times."""
        once = isinstance(self.content.get(name), dict)
        rows: list[_Values] = content.get(name, [])
        return [
            self.made(of, (name,) if once else (name, number), one)
            for number, one in enumerate(rows)
        ]

    def name_materials(
        self, table: str, values: _Values, library: Mapping[str, LibraryMaterial]
    ) -> None:
        """Put the materials of a library in the place of their names."""
        for role in (role for role in KIND_OF if role in values):
            try:
                values[role] = named(library, values[role], KIND_OF[role])
            except FileError as caught:
                self.fail((table or self.homes[role], role), str(caught))

    def resolved(
        self, layers: Sequence[tuple[str, _Values]]
    ) -> tuple[Scene, dict[str, LibraryMaterial]]:
        """Return a scene of values that may not fit each other, and its named materials.

        Layers have values, each over those before, and their table; "" for those of the scene.
        """
        default = self.kind()
        try:
            values, materials = numbers_of(default, [values for _, values in layers])
            return default.updated(**values), materials
        except ParameterError as caught:
            given = {key for _, values in layers for key in values}
            key = next(filter(given.__contains__, _named(str(caught), caught.key)), str(caught.key))
            tables = [table for table, values in layers if key in values]
            home = self.homes.get(key)
            place = () if home is None else ((tables or [""])[-1] or home, key)
            self.fail(place, str(caught))


def _coarser(plain: Scene) -> _Values:
    """Return what the quick variant of a scene changes."""
    quick = plain.coarse()
    changed = {key: quick.value(key) for key in plain.described()}
    return {key: value for key, value in changed.items() if value != plain.value(key)}
