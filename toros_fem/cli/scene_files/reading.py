"""Scene files, read strictly: a wrong key or value is told with file, line and remedy."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

from mpi4py import MPI

from toros_fem.base.errors import LibraryError, ParameterError, SceneError
from toros_fem.base.keys import NONE, Table, nearest, plain_value
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.scene import Scene
from toros_fem.base.toml_files.document import Document, read_text
from toros_fem.base.toml_files.lines import Place, line_of
from toros_fem.cli.scene_files.materials import FILE, KIND_OF, TABLE, NamedMaterials, roles_of
from toros_fem.materials.library import LibraryMaterial, read_library
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
        materials: Materials of the library that its numbers come from: those of "fabric",
            "reinforcement" and "bladder" that it names.
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
    return _Reader(path, found, comm).scene(coarse, changes)


class _Reader(Document):
    """One scene file, while it is read."""

    def __init__(self, path: Path, text: str, comm: MPI.Comm | None) -> None:
        super().__init__(path, text, SceneError)
        self.comm = comm

    def scene(self, coarse: bool, changes: Sequence[str]) -> SceneFile:
        kind = self.kind()
        roles = roles_of(kind)
        sections = {name: tuple(of.described()) for name, of in kind.tables().items()}
        if roles:
            sections[TABLE] = (*roles, *sections[TABLE])
        tables = (*sections, *kind.entries(), "files", "coarse")
        self.known(self.content, ("kind", *tables), (), sections)
        files = self.files(kind)
        self.materials = NamedMaterials(self.library(kind, roles, changes))
        values: dict[str, Any] = {}
        places: dict[str, Place] = {}
        for section, names in sections.items():
            for name, value in self.table(section).items():
                self.known([name], names, (section,), sections)
                places[name] = (section, name)
                values[name] = self.value(kind(), name, value, (section, name))
        for name, of in kind.entries().items():
            places[name] = (name,)
            values[name] = self.entries(name, of)
        self.check_names(values, places)
        config = self.updated(kind, kind(), values, places)
        over: dict[str, Any] = {}
        every = [name for names in sections.values() for name in names]
        for name, value in self.table("coarse").items():
            self.known([name], every, ("coarse",), {})
            over[name] = self.value(kind(), name, value, ("coarse", name))
        places = {n: ("coarse", n) for n in over}
        self.check_names(over, places)
        if coarse:
            config = self.updated(kind, config, over, places, kind.coarse)
        lines = {name: line_of(self.lines, ("files", name)) or 0 for name in files}
        scene = SceneFile(self.path, kind, config, files, lines)
        scene = self.changed(scene, sections, changes)
        return replace(scene, materials=self.materials.entries)

    def library(
        self, kind: type[Scene], roles: Sequence[str], changes: Sequence[str]
    ) -> Mapping[str, LibraryMaterial]:
        """Return the materials that names are looked up in (collective)."""
        if not roles:
            return {}
        paths = [self.path.parent / path] if (path := self.file_path(FILE)) is not None else []
        for change in changes:
            key, equals, text = change.partition("=")
            if key.strip() == f"files.{FILE}" and equals:
                path = _path(change, text, key)
                paths = [] if path == NONE else [Path(path)]
        return read_library(*paths, comm=self.comm)

    def check_names(self, values: Mapping[str, Any], places: Mapping[str, Place]) -> None:
        """Check names of materials, and that no number stands for the same as one."""
        for role in (role for role in KIND_OF if role in values):
            try:
                self.materials.entry(role, values[role])
            except LibraryError as caught:
                self.fail(places[role], str(caught))
        found = self.materials.conflict(values)
        if found is not None:
            role, number = found
            line = line_of(self.lines, places[role])
            self.fail(
                places[number],
                f"{role} = {values[role]!r} in line {line} stands for this number too. Keep the "
                "name or the number.",
            )

    def entries(self, name: str, of: type[Table]) -> tuple[Table, ...]:
        """Return the entries of a table that may stand several times, as [name] or [[name]]."""
        given = self.content.get(name, [])
        tables = [given] if isinstance(given, dict) else given
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            self.fail((name,), f"must be a table [{name}], or several [[{name}]].")
        found = []
        for k, table in enumerate(tables):
            at: Place = (name,) if isinstance(given, dict) else (name, k)
            values: dict[str, Any] = {}
            for key, value in table.items():
                self.known([key], tuple(of.described()), at, {})
                values[key] = self.value(of, key, value, (*at, key))
            try:
                found.append(of(**values))
            except ParameterError as caught:
                self.fail((*at, caught.key or "") if caught.key in table else at, str(caught))
        return tuple(found)

    def kind(self) -> type[Scene]:
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

    def known(
        self,
        given: Iterable[str],
        names: Sequence[str],
        within: Place,
        sections: Mapping[str, Sequence[str]],
    ) -> None:
        """Check that keys are known here; the error names the nearest one, or its table."""
        for name in given:
            if name in names:
                continue
            word = "table" if not within and isinstance(self.content[name], dict | list) else "key"
            elsewhere = [s for s, others in sections.items() if name in others]
            if elsewhere:
                advice = f"it stands in the table [{elsewhere[0]}]."
            else:
                everywhere = [n for others in sections.values() for n in others]
                near = difflib.get_close_matches(name, names, n=1)
                other = [] if near else difflib.get_close_matches(name, everywhere, n=1)
                home = [s for s, others in sections.items() if other and other[0] in others]
                if home:
                    advice = f"did you mean {other[0]!r}, in the table [{home[0]}]?"
                else:
                    advice = nearest(name, names)
            self.fail((*within, name), f"unknown {word} {name!r}; {advice}")

    def value(self, config: Scene | type[Table], name: str, value: Any, place: Place) -> Any:
        """Return the value of a field, in its unit, or the name of a material."""
        try:
            return _value(config, name, value)
        except ParameterError as caught:
            self.fail(place, str(caught))

    def updated(
        self,
        kind: type[Scene],
        config: Scene,
        values: Mapping[str, Any],
        places: Mapping[str, Place],
        variant: Callable[[Scene], Scene] = lambda config: config,
    ) -> Scene:
        """Return a variant of a configuration with other values, which may not fit each other."""
        try:
            return variant(config).updated(**self.materials.resolve(config, kind(), values))
        except ParameterError as caught:
            if (place := places.get(caught.key or "")) is not None:
                self.fail(place, str(caught))
            raise SceneError(f"{self.path}: {caught}", self.path, key=caught.key) from None

    def files(self, kind: type[Scene]) -> dict[str, Path]:
        known = (*kind.files(), FILE) if roles_of(kind) else tuple(kind.files())
        self.known(self.table("files"), known, ("files",), {})
        found = {name: self.file_path(name) for name in kind.files()}
        return {name: self.path.parent / path for name, path in found.items() if path is not None}

    def file_path(self, name: str) -> str | None:
        """Return the path of a file as the table `files` has it; None without."""
        value = self.table("files").get(name, NONE)
        if not isinstance(value, str) or not value or "\0" in value:
            self.fail(("files", name), f"{value!r} must be a path, in quotes.")
        return None if value == NONE else value

    def changed(
        self, scene: SceneFile, sections: Mapping[str, Sequence[str]], changes: Sequence[str]
    ) -> SceneFile:
        """Return the scene with the values of the command line."""
        values: dict[str, Any] = {}
        files = dict(scene.files)
        for change in changes:
            key, equals, text = change.partition("=")
            section, _, name = key.strip().rpartition(".")
            if not equals or not name:
                raise SceneError(
                    f"change {change!r}: write KEY=VALUE, design.seed=3 for instance.", key=name
                )
            if section == "files":
                if name == FILE and TABLE in sections:
                    continue  # `library` has read it
                if name not in scene.kind.files():
                    _refuse(change, nearest(name, tuple(scene.kind.files())), name)
                value = _path(change, text, key)
                if value == NONE:
                    files.pop(name, None)
                else:
                    files[name] = Path(value)
                continue
            entries = scene.config.entries()
            if section in entries:
                now = values.get(section, getattr(scene.config, section))
                of = entries[section]
                if name not in of.described():
                    _refuse(change, f"unknown key; {nearest(name, of.described())}", key)
                if len(now) > 1:
                    _refuse(change, f"the file has {len(now)} tables {section}; edit it.", key)
                try:
                    value = of.described()[name].read(plain_value(text.strip()))
                    one = of(**{name: value}) if not now else now[0].updated(**{name: value})
                except ParameterError as caught:
                    _refuse(change, str(caught), key)
                values[section] = (one,)
                continue
            if section and section not in sections:
                known = (*sections, *entries)
                _refuse(change, f"unknown table; {nearest(section, known)}", key)
            names = sections.get(section) or [n for some in sections.values() for n in some]
            if name not in names:
                _refuse(change, f"unknown key; {nearest(name, names)}", key)
            try:
                values[name] = _value(scene.config, name, plain_value(text.strip()))
                if (found := self.materials.conflict(values)) is not None:
                    _refuse(change, "{} stands for {} too; keep one of both.".format(*found), key)
            except (ParameterError, LibraryError) as caught:
                _refuse(change, str(caught), key)
        try:
            resolved = self.materials.resolve(scene.config, scene.kind(), values)
            config = scene.config.updated(**resolved)
        except ParameterError as caught:
            raise SceneError(f"{self.path}, as changed: {caught}", self.path) from None
        lines = {name: k for name, k in scene.lines.items() if files.get(name) is scene.files[name]}
        return replace(scene, config=config, files=files, lines=lines)


def _refuse(change: str, why: str, key: str) -> NoReturn:
    raise SceneError(f"change {change!r}: {why}", key=key) from None


def _path(change: str, text: str, key: str) -> str:
    """Return the path that a change gives."""
    value = plain_value(text.strip())
    if not isinstance(value, str) or not value or "\0" in value:
        _refuse(change, "the value must be a path.", key)
    return value


def _value(config: Scene | type[Table], name: str, value: Any) -> Any:
    """Return the value of a field, in its unit, or the name of a material.

    Raises:
        ParameterError: It has another type or unit, or is out of its bounds.
    """
    if name not in KIND_OF:
        return config.described()[name].read(value)
    if not isinstance(value, str):
        raise ParameterError(f"{value!r} must be the name of a material, in quotes.")
    return value
