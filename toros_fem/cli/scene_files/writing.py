"""Scene files, written with the meaning, unit and bounds of each key."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Key, Table, quoted
from toros_fem.base.scene import Scene
from toros_fem.cli.scene_files.layout import HOLDS, MATERIAL, QUICK
from toros_fem.cli.scene_files.materials import names_of
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.products.kinds import ABOUT

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
