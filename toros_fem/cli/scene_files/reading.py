"""Scene files, read strictly: a wrong key or value is told with file, line and remedy."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

from mpi4py import MPI

from toros_fem.base.errors import LibraryError, ParameterError, SceneError
from toros_fem.base.keys import NONE, Key, Table, nearest, plain_value
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.scene import Scene
from toros_fem.base.toml_files.document import Document, read_text
from toros_fem.base.toml_files.lines import Place, line_of
from toros_fem.cli.scene_files.materials import (
    FILE,
    KIND_OF,
    TABLE,
    numbers_of,
    roles_of,
    values_of,
)
from toros_fem.materials.library.files import named, read_library
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.products.kinds import KINDS


@dataclass(frozen=True)
class SceneFile:
    """A scene that was read.

    Attributes:
        path: The file.
        kind: Its kind.
        config: Its numbers.
        files: Files and folders that it names, by name, absolute or relative to the current folder.
        lines: Line of each of these in the file; none where the command line gives it.
        materials: Materials of the library that it names, by "fabric", "reinforcement" and
            "bladder"; numbers that are given beside a name beat those of the material.
    """

    path: Path
    kind: type[Scene]
    config: Scene
    files: Mapping[str, Path]
    lines: Mapping[str, int]
    materials: Mapping[str, LibraryMaterial] = field(default_factory=dict)

    def require_files(self, comm: MPI.Comm) -> None:
        """Check that the files and folders that it names are there (collective).

        Raises:
            SceneError: One is not; with file, line and key. It is raised on all ranks.
        """
        missing = on_first_rank(
            comm, lambda: [name for name, path in self.files.items() if not path.exists()]
        )
        for name in missing:
            line = self.lines.get(name)
            at = "" if line is None else f"{self.path}, line {line}: "
            raise SceneError(
                f"{at}files.{name}: there is no {self.files[name]}. Paths in a scene file are "
                "relative to it, those of the command line to the current folder.",
                self.path,
                line,
                f"files.{name}",
            )


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
        coarse: Whether to take the quick variant, with the values in the table `coarse` of the
            file.
        changes: Texts "KEY=VALUE" that override the file and the quick variant. The key may come
            with its table: "design.seed=3". Paths are relative to the current folder.

    Raises:
        SceneError: The file cannot be read, is no TOML, or a key or value is wrong; with file,
            line, key and remedy. It is raised on all ranks.
        LibraryError: So is its file of materials.
    """
    path = Path(path)

    def text() -> str:
        return read_text(path, "a scene file", SceneError)

    found = text() if comm is None else on_first_rank(comm, text)
    return _Reader(path, found).scene(comm, coarse, [_split(change) for change in changes])


@dataclass(frozen=True)
class _Change:
    """A change "TABLE.KEY=VALUE" of the command line.

    Attributes:
        text: As it was given.
        table, key: What it changes; the table may be missing.
        value: The value, as a file would hold it.
    """

    text: str
    table: str
    key: str
    value: Any


# Where a value is given: a place of the file, or a change.
_Origin = Place | _Change
# Values by their keys, each with where it is given.
_Layer = dict[str, tuple[_Origin, Any]]


def _split(change: str) -> _Change:
    key, equals, text = change.partition("=")
    table, _, name = key.strip().rpartition(".")
    if not equals or not name:
        raise SceneError(
            f"change {change!r}: write KEY=VALUE, design.seed=3 for instance.", key=name
        )
    return _Change(change, table, name, plain_value(text))


class _Reader(Document):
    """One scene file, while it is read.

    Attributes:
        kind: Its kind.
        sections, homes: Keys of each table that stands once, and the table of each key.
        origins: Where each value is given.
        numbers, materials: Values that were given, and materials by their roles.
    """

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(path, text, SceneError)
        self.kind = self._kind()
        self.sections = {name: list(of.described()) for name, of in self.kind.tables().items()}
        if roles := roles_of(self.kind):
            self.sections[TABLE] = [*roles, *self.sections[TABLE]]
        self.homes = {key: table for table, keys in self.sections.items() for key in keys}
        self.origins: dict[str, _Origin] = {}
        self.numbers: dict[str, Any] = {}
        self.materials: dict[str, LibraryMaterial] = {}
        self.library: Mapping[str, LibraryMaterial] = {}

    def scene(self, comm: MPI.Comm | None, coarse: bool, changes: Sequence[_Change]) -> SceneFile:
        tables = ["kind", *self.sections, *self.kind.entries(), "files", "coarse"]
        for name, value in self.content.items():
            word = "table" if isinstance(value, dict | list) else "key"
            self.require_known((name,), name, tables, word, self.homes)
        files = self.files(changes)
        if roles_of(self.kind):
            path, _ = files.pop(FILE, (None, None))
            self.library = read_library(*([] if path is None else [path]), comm=comm)
        of_file, of_quick, over = _Layer(), _Layer(), _Layer()
        for section, keys in {**self.sections, "coarse": list(self.homes)}.items():
            layer = of_quick if section == "coarse" else of_file
            for name, value in self.table(section).items():
                self.read(layer, (section, name), name, value, keys)
        for name, of in self.kind.entries().items():
            of_file[name] = (name,), self.entries(name, of)
        config = self.updated(self.kind(), of_file)
        if coarse:
            config = self.updated(config, of_quick, quick=True)
        for change in (one for one in changes if one.table != "files"):
            if change.table in self.kind.entries():
                now = over.get(change.table, of_file[change.table])[1]
                over[change.table] = change, self.changed_entry(change, now)
                continue
            if change.table:
                known = [*self.sections, *self.kind.entries(), "files"]
                self.require_known(change, change.table, known, "table", self.homes)
            keys = self.sections.get(change.table, list(self.homes))
            self.read(over, change, change.key, change.value, keys)
        config = self.updated(config, over)
        there = {name: path for name, (path, _) in files.items() if path is not None}
        lines = {name: line for name, (_, line) in files.items() if line is not None}
        return SceneFile(self.path, self.kind, config, there, lines, self.materials)

    def fail(self, place: _Origin, message: str) -> NoReturn:
        """Raise the error of a key of the file, or of a change."""
        if isinstance(place, _Change):
            raise SceneError(f"change {place.text!r}: {message}", key=place.key) from None
        super().fail(place, message)

    def _kind(self) -> type[Scene]:
        if "kind" not in self.content:
            known = ", ".join(KINDS)
            raise SceneError(
                f'{self.path}: it names no kind. Begin with kind = "bend", or one of {known}.',
                self.path,
                key="kind",
            )
        name = self.content["kind"]
        if not isinstance(name, str) or name not in KINDS:
            self.fail(("kind",), f"{name!r} is no kind; {nearest(str(name), KINDS)}")
        return KINDS[name]

    def table(self, name: str) -> dict[str, Any]:
        found = self.content.get(name, {})
        if not isinstance(found, dict):
            self.fail((name,), f"must be a table: write [{name}], and its keys in lines below.")
        return found

    def require_known(
        self,
        place: _Origin,
        name: str,
        names: Sequence[str],
        word: str = "key",
        homes: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Check that a key is known here; the error names the nearest one, or its home."""
        if name in names:
            return
        near = difflib.get_close_matches(name, names, n=1)
        far = [] if near else difflib.get_close_matches(name, homes, n=1)
        advice = nearest(name, names)
        if name in homes:
            advice = f"it stands in the table [{homes[name]}]."
        elif far:
            advice = f"did you mean {far[0]!r}, in the table [{homes[far[0]]}]?"
        self.fail(place, f"unknown {word} {name!r}; {advice}")

    def read(
        self, layer: _Layer, place: _Origin, name: str, value: Any, names: Sequence[str]
    ) -> None:
        """Add a value to a layer: in its unit, or the material of a name."""
        self.require_known(place, name, names, homes=self.homes)
        if name not in KIND_OF:
            layer[name] = place, self.value(self.kind.described()[name], place, value)
        elif not isinstance(value, str):
            self.fail(place, f"{value!r} must be the name of a material, in quotes.")
        else:
            try:
                layer[name] = place, named(self.library, value, KIND_OF[name])
            except LibraryError as caught:
                self.fail(place, str(caught))

    def value(self, key: Key, place: _Origin, value: Any) -> Any:
        try:
            return key.read(value)
        except ParameterError as caught:
            self.fail(place, str(caught))

    def entries(self, name: str, of: type[Table]) -> tuple[Table, ...]:
        """Return the entries of a table that may stand several times, as [name] or [[name]]."""
        given = self.content.get(name, [])
        tables = [given] if isinstance(given, dict) else given
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            self.fail((name,), f"must be a table [{name}], or several [[{name}]].")
        found, keys = [], of.described()
        for k, table in enumerate(tables):
            at: Place = (name,) if isinstance(given, dict) else (name, k)
            for key in table:
                self.require_known((*at, key), key, list(keys))
            values = {key: self.value(keys[key], (*at, key), v) for key, v in table.items()}
            try:
                found.append(of(**values))
            except ParameterError as caught:
                self.fail((*at, caught.key or "") if caught.key in table else at, str(caught))
        return tuple(found)

    def changed_entry(self, change: _Change, now: Sequence[Table]) -> tuple[Table, ...]:
        """Return the entry of a table that stands once at most, with another value."""
        of = self.kind.entries()[change.table]
        self.require_known(change, change.key, list(of.described()))
        if len(now) > 1:
            self.fail(change, f"the file has {len(now)} tables {change.table}; edit it.")
        value = {change.key: self.value(of.described()[change.key], change, change.value)}
        try:
            return (now[0].updated(**value) if now else of(**value),)
        except ParameterError as caught:
            self.fail(change, str(caught))

    def files(self, changes: Sequence[_Change]) -> dict[str, tuple[Path | None, int | None]]:
        """Return path and line of each file that is named, or changed; None for none."""
        known = [*self.kind.files(), *([FILE] if roles_of(self.kind) else [])]
        given: _Layer = {n: (("files", n), value) for n, value in self.table("files").items()}
        given |= {one.key: (one, one.value) for one in changes if one.table == "files"}
        found: dict[str, tuple[Path | None, int | None]] = {}
        for name, (place, value) in given.items():
            self.require_known(place, name, known)
            if not isinstance(value, str) or not value or "\0" in value:
                self.fail(place, f"{value!r} must be a path, in quotes.")
            if isinstance(place, _Change):  # relative to the current folder
                path, line = Path(value), None
            else:
                path, line = self.path.parent / value, line_of(self.lines, place)
            found[name] = (None, None) if value == NONE else (path, line)
        return found

    def updated(self, config: Scene, layer: _Layer, *, quick: bool = False) -> Scene:
        """Return a configuration, or its quick variant, with values that may not fit each other."""
        self.origins |= {name: place for name, (place, _) in layer.items()}
        values = {name: value for name, (_, value) in layer.items()}
        for role in (role for role in KIND_OF if role in values):
            self.materials[role] = entry = values.pop(role)
            for name in values_of(role, entry):  # of an earlier layer
                self.numbers.pop(name, None)
        self.numbers |= values
        try:
            by_name = numbers_of(self.materials, self.numbers, self.kind())
            return (config.coarse() if quick else config).updated(**by_name, **values)
        except ParameterError as caught:
            if caught.key in self.origins:
                self.fail(self.origins[caught.key], str(caught))
            raise SceneError(f"{self.path}: {caught}", self.path, key=caught.key) from None
