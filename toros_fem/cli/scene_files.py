"""Scene files: their keys and materials by name, how they are read, and how they are written."""

from __future__ import annotations

import contextlib
import re
import textwrap
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, Required

from mpi4py import MPI
from pydantic import BeforeValidator, TypeAdapter

from toros_fem.base.errors import FileError, OutlineError, ParameterError
from toros_fem.base.keys import (
    File,
    Key,
    Table,
    given_of,
    meant,
    nearest,
    plain_value,
    quoted,
    typed,
)
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.scene import Document, Place, Scene, at, read_text
from toros_fem.base.validation import shown
from toros_fem.materials.library.files import named, read_library
from toros_fem.materials.library.material import THREADS, LibraryMaterial
from toros_fem.materials.sheet import Material, print_offset, reinforced
from toros_fem.products.kinds import ABOUT, KINDS

# The role of each name: the kind of material, and the fields that it stands for.
KIND_OF: Mapping[str, str] = MappingProxyType(
    {"fabric": "fabric", "reinforcement": "print", "bladder": "rubber"}
)
_SHEET = ("poisson", "thickness", "c1", "c2")
# Fields that not every kind of scene has.
MASSES = ("fabric_mass", "print_mass")
# Table of materials; that of files, with the key of a file of materials; and the quick variant's.
MATERIAL, FILES, LIBRARY, QUICK = "material", "files", "materials", "coarse"
# Tables of further poses.
POSE = "pose"
# What the tables hold that are no tables of the scene.
HOLDS: Mapping[str, str] = {
    FILES: "Files and folders, relative to the scene file",
    QUICK: "Values of the quick variant, --coarse, instead of those above",
    POSE: "A further pose of the same skin, with what differs from those above",
}
DIALECT = "https://json-schema.org/draft/2020-12/schema"
# Stands for the table of keys that the command line changes.
CHANGED = "--set"
# Keys that a message names: with a value, or of several words.
KEYS_IN_MESSAGE = re.compile(r"\b(\w+(?= = )|[a-z0-9]+_\w+)")
# Values by their keys.
_Values = dict[str, Any]
WIDTH = 96
# Tables that a new file shows with their values; those of the others are shown as comments.
SHOWN = ("target", "object", "skin", "material", "pressure", "contact", "pull")
HEAD = """\
Values have a unit, as in "5 kPa" or "0.6 mm", or are plain numbers: in SI units, angles in degrees,
and in per cent where the text says so. "none" leaves a thing out. A key behind # has its default
value: take the # away to change it. Paths are relative to this file."""
SHORT = """\
These are the keys that a new scene changes. `toros new --all` writes the others too. Values have a
unit, as in "5 kPa", or are in SI units, angles in degrees; "none" leaves a thing out. Paths are
relative to this file."""
DEFAULTS = {"fabric": "jersey-light", "reinforcement": "printed-tpu-95a-on-jersey"}
EXAMPLES = {
    "fabric": "jersey-light",
    "reinforcement": "printed-tpu-95a",
    "bladder": "dragon-skin-20",
}
_PRINT = {f"reinforcement_{name}": name for name in ("young", *_SHEET)}
FIELDS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "fabric": {
            "fabric_young": "young",
            **{name: name for name in (*_SHEET, "knit_ratio", *THREADS)},
            "fabric_mass": "density",
            "tested_stretch": "tested_stretch",
        },
        "reinforcement": {**_PRINT, "print_mass": "density"},
        "bladder": {f"bladder_{name}": name for name in ("young", "thickness", "second", "third")},
    }
)
NAMES: Mapping[str, Key] = MappingProxyType(
    {
        role: Key(role, str, str, f"name of a {kind}, for its numbers")
        for role, kind in KIND_OF.items()
    }
)


def names_of(kind: type[Scene]) -> dict[str, Key]:
    """Return the keys that name materials; none where a kind has no materials."""
    known = kind.described()
    return {role: one for role, one in NAMES.items() if next(iter(FIELDS[role])) in known}


def numbers_of(
    default: Scene, layers: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Any], dict[str, LibraryMaterial]]:
    """Return the values of a scene, and the material of each role that is named.

    A number beats a name beside it or before it, a name the numbers before it. A print that is the
    printed layer alone goes onto the fabric that names, numbers or defaults give. Layers have
    values by key, each over those before; materials by their roles.

    Raises:
        ParameterError: A material has a value for which the scene has no field.
    """
    given, materials = dict[str, Any](), dict[str, LibraryMaterial]()
    for layer in layers:
        for role in (role for role in KIND_OF if role in layer):
            materials[role] = layer[role]
            for key in _values(role, layer[role]):
                given.pop(key, None)
        given |= {key: value for key, value in layer.items() if key not in KIND_OF}

    known, found = default.described(), dict[str, Any]()
    for role, entry in materials.items():
        values = _values(role, entry)
        for key in values:
            if key not in known and key not in MASSES:
                raise ParameterError(
                    f"{role}: {entry.name!r} has a {key}, which scenes of this kind have not. "
                    "Give its other numbers instead of its name.",
                    role,
                )
        found |= values
    printed = materials.get("reinforcement")
    if printed is not None and not printed.with_fabric:
        fabric = {key: default.value(key) for key in ("fabric_young", *_SHEET)} | found | given
        found |= _laid(fabric, printed)
    return {key: value for key, value in found.items() if key in known} | given, materials


def _values(role: str, entry: LibraryMaterial) -> dict[str, Any]:
    """Return the fields that a material has a value for in its role."""
    values = {key: getattr(entry, name) for key, name in FIELDS[role].items()}
    if entry.with_fabric:  # its density is that of both
        values.pop("print_mass", None)
    return {key: value for key, value in values.items() if value is not None}


def _laid(fabric: Mapping[str, Any], entry: LibraryMaterial) -> dict[str, Any]:
    """Return the fields of the reinforcement of a fabric with a printed layer on it."""
    plain = Material(fabric["fabric_young"], *(fabric[key] for key in _SHEET))
    sheet = reinforced(plain, entry.material)
    values = {key: getattr(sheet, name) for key, name in _PRINT.items()}
    for name in ("c1", "c2"):  # bounds of the fabric stay those of the fabric
        if values[f"reinforcement_{name}"] == fabric[name]:
            values[f"reinforcement_{name}"] = None
    offset = print_offset(plain, entry.material)
    return {**values, "print_offset": offset, "print_height": entry.thickness}


def keys_of(kind: type[Scene]) -> dict[str, Mapping[str, Key]]:
    """Return the keys of each table of scene files of a kind."""
    tables: dict[str, Mapping[str, Key]] = {
        name: of.described() for name, of in kind.tables().items()
    }
    files, names = kind.files(), names_of(kind)
    if names:
        tables[MATERIAL] = {**names, **tables[MATERIAL]}
        files[LIBRARY] = "a file of materials"
    every = {name: one for keys in tables.values() for name, one in keys.items()}
    paths = {
        name: Key(name, File | None, Path, text, optional=True) for name, text in files.items()
    }
    several = {name: of.described() for name, of in kind.entries().items()}
    keys = {**tables, FILES: paths, QUICK: every, **several}
    return {**keys, POSE: poses} if (poses := kind.pose_keys()) else keys


def file_type(kind: type[Scene]) -> TypeAdapter[dict[str, Any]]:
    """Return the type of the content of scene files of a kind: tables with the keys that one gives.

    It also makes the JSON schema for editors, where bounds of a value with a unit are left out:
    JSON schema knows no units.
    """
    holds = {**{name: of.holds() for name, of in kind.tables().items()}, **HOLDS}
    entries = kind.entries()
    content: dict[str, Any] = {"kind": Required[Literal[kind.KIND]]}
    for name, keys in keys_of(kind).items():
        of = entries.get(name)
        content[name] = given_of(name, holds[name] if of is None else of.holds(), keys)
        if of is not None or name == POSE:
            content[name] = several(content[name])
    return TypeAdapter(typed(kind.KIND, ABOUT[kind.KIND], content))


def scene_schema(kind: type[Scene]) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of scene files of a kind."""
    return {"$schema": DIALECT, **file_type(kind).json_schema()}


def several(table: Any) -> Any:
    """Return the type of a table that may stand once, or several times."""
    listed: Any = list[table]

    def read(content: Any) -> Any:
        return [content] if isinstance(content, dict) else content

    return Annotated[listed, BeforeValidator(read, json_schema_input_type=table | listed)]


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
        files, quick, poses = (content.pop(name, {}) for name in (FILES, QUICK, POSE))
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
        if poses:
            config = self.with_poses(config, poses)
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
        apart = table in (FILES, POSE) or table in entries
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
        apart = place[0] in (FILES, POSE) or place[0] in self.kind.entries()
        homes = {} if apart else self.homes
        if name in homes:
            return f"it stands in the table [{homes[name]}]."
        if place[0] == CHANGED and name in self.keys[FILES]:
            return f"write {FILES}.{name}."
        far = meant(name, homes)
        if far is not None and meant(name, known) is None:
            return f"did you mean {far!r}, in the table [{homes[far]}]?"
        return nearest(name, known)

    def with_poses(self, scene: Scene, poses: Sequence[_Values]) -> Scene:
        """Return a scene with further poses, of values by key."""
        once = isinstance(self.content.get(POSE), dict)
        made: tuple[_Values, ...] = ()
        for number, values in enumerate(poses):
            made = (*made, values)
            try:
                scene = replace(scene, poses=made)  # type: ignore[call-arg]
            except ParameterError as caught:
                key = next(filter(values.__contains__, _named(str(caught), caught.key)), None)
                place: Place = (POSE,) if once else (POSE, number)
                self.fail(place if key is None else (*place, key), str(caught))
        return scene

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


def scene_text(
    scene: Scene,
    files: Mapping[str, str | Path] | None = None,
    materials: Mapping[str, LibraryMaterial] | None = None,
) -> str:
    """Return a scene file with every key, which `read_scene` turns into the same numbers.

    Keys of some tables stand with their values, the others as comments as long as they have their
    defaults. A comment names the materials that the numbers come from, as of `SceneFile`.

    Raises:
        ParameterError: A file is unknown.
    """
    default, quick, known = type(scene)(), scene.coarse(), scene.described()

    def every(table: str, keys: Sequence[Key]) -> list[str]:
        lines = _materials(scene, materials or {}) if table == MATERIAL else []
        for one in keys:
            value = scene.value(one.name)
            hidden = table not in SHOWN and value == default.value(one.name)
            lines += [*_comment(one.help), _line(one, value, hidden=hidden)]
        return lines

    lines = _text(scene, HEAD, files or {}, every)
    lines += ["", *_comment(HOLDS[QUICK]), f"[{QUICK}]"]
    changed = [one for name, one in known.items() if quick.value(name) != scene.value(name)]
    lines += [_line(one, quick.value(one.name), hidden=True) for one in changed]
    return "\n".join(lines) + "\n"


def short_scene_text(kind: type[Scene], names: Mapping[str, str] | None = None) -> str:
    """Return a scene file with the few keys that a new user changes.

    Materials are named by their roles; without, they are those of the default numbers.
    """
    scene = kind.example()
    # The default print is one sheet with the default fabric; on another one it is a layer.
    usual = EXAMPLES if "fabric" in (names or {}) else DEFAULTS
    named = {role: usual[role] for role in names_of(kind) if role in DEFAULTS} | dict(names or {})

    def few(table: str, keys: Sequence[Key]) -> list[str]:
        lines = [f"{role} = {quoted(name)}" for role, name in named.items()]
        lines = lines if table == MATERIAL else []
        for one in (one for one in keys if one.name in kind.FEW):
            lines += [*_comment(one.help), _line(one, scene.value(one.name))]
        return lines

    return "\n".join(_text(scene, SHORT, kind.EXAMPLE_FILES, few)) + "\n"


def _text(
    scene: Scene,
    head: str,
    files: Mapping[str, str | Path],
    lines_of: Callable[[str, Sequence[Key]], list[str]],
) -> list[str]:
    """Return the lines of a file: kind, files, and the tables that have lines."""
    about, known = ABOUT[scene.KIND], scene.files()
    if unknown := sorted(files.keys() - known):
        raise ParameterError(f"files names {unknown[0]!r}; known are {sorted(known)}.")
    lines = [*_comment(f"{about[0].upper()}{about[1:]}."), *_comment(head), ""]
    lines += [f'kind = "{scene.KIND}"', *(["", "[files]"] if known else [])]
    for name, text in known.items():
        path = files.get(name)
        named = f'#{name} = ""' if path is None else f"{name} = {quoted(str(path))}"
        lines += [*_comment(text), named]
    for table, of in scene.tables().items():
        if found := lines_of(table, list(of.described().values())):
            lines += ["", *_comment(of.holds()), f"[{table}]", *found]
        if table == "skin":
            for name, several in scene.entries().items():
                lines += _entries(name, several, getattr(scene, name))
    for values in getattr(scene, "poses", ()):
        keys = scene.pose_keys()
        rows = [_line(keys[name], value) for name, value in values.items()]
        lines += ["", *_comment(HOLDS[POSE]), f"[[{POSE}]]", *rows]
    return lines


def _materials(scene: Scene, materials: Mapping[str, LibraryMaterial]) -> list[str]:
    """Return comments on names of materials: those that numbers come from, or how to name any."""
    if not materials:
        names = ", ".join(f"{role} = {quoted(EXAMPLES[role])}" for role in names_of(type(scene)))
        return _comment(
            f"Materials may also come by name, in the place of these numbers: {names}. `toros "
            "materials` lists them. A file of your own is named by materials = "
            '"my_materials.toml" in the table [files].'
        )
    lines = _comment("The numbers were those of these materials:")
    for role, entry in materials.items():
        low, high = entry.stretch_range
        text = f"{role} = {quoted(entry.name)}: {entry.title}; {entry.trust}, for stretches of "
        lines += _comment(f"{text}{low:g} to {high:g}; {entry.source}")
    return lines


def _entries(name: str, of: type[Table], values: Sequence[Table]) -> list[str]:
    """Return the tables of a name that may stand several times."""
    lines = ["", *_comment(f"{of.holds()}; one table [{name}], or several [[{name}]]")]
    keys = of.described().values()
    for one in keys:
        lines += _comment(f"{one.name}: {one.help}")
    if not values:
        lines += [f"#[{name}]", *(_line(one, one.default, hidden=True) for one in keys)]
    for value in values:
        lines.append(f"[{name}]" if len(values) == 1 else f"[[{name}]]")
        own = ((one, getattr(value, one.name)) for one in keys)
        lines += [_line(one, found, hidden=found == one.default) for one, found in own]
    return lines


def _line(one: Key, value: Any, *, hidden: bool = False) -> str:
    return f"{'#' * hidden}{one.name} = {one.written(value)}"


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, WIDTH - 2, break_long_words=False)]
