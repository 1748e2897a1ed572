"""Scene files, written with the meaning, unit and bounds of each key."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Table, quoted
from toros_fem.base.scene import Scene
from toros_fem.cli.scene_files.materials import TABLE, roles_of
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
These are the keys that a new scene changes. `toros new --all` writes the others too, and `toros
explain KEY` says what one means. Values have a unit, as in "5 kPa", or are in SI units, angles in
degrees; "none" leaves a thing out. Paths are relative to this file."""


DEFAULTS = {"fabric": "jersey-light", "reinforcement": "tpu-95a-on-jersey"}
EXAMPLES = {"fabric": "jersey-light", "reinforcement": "tpu-95a", "bladder": "dragon-skin-20"}


def scene_text(
    kind: type[Scene],
    config: Scene | None = None,
    files: Mapping[str, str | Path] | None = None,
    materials: Mapping[str, LibraryMaterial] | None = None,
) -> str:
    """Return a scene file with every key, which `read_scene` turns into the same numbers.

    Keys of some tables stand with their values, the others as comments as long as they have their
    defaults.

    Args:
        kind: The kind.
        config: Its numbers; None takes those of the kind's example, with its files.
        files: Files and folders by name; by default None.
        materials: Materials of the library that the numbers come from, as of `SceneFile`; a comment
            names them. By default none.

    Raises:
        ParameterError: The configuration is not that of the kind, or a file is unknown.
    """
    if config is None:
        config, files = kind.example(), {**kind.EXAMPLE_FILES, **(files or {})}
    if type(config) is not kind:
        raise ParameterError(
            f"config is a {type(config).__name__}; a scene of the kind {kind.KIND!r} has a "
            f"{kind.__name__}."
        )
    unknown = sorted(set(files or {}) - set(kind.files()))
    if unknown:
        raise ParameterError(f"files names {unknown[0]!r}; known are {sorted(kind.files())}.")
    lines = _opening(kind, HEAD, files or {})
    keys = config.described()
    for section, of in config.tables().items():
        lines += ["", *_comment(of.holds()), f"[{section}]"]
        if section == TABLE:
            lines += _materials(config, materials or {})
        for name in of.described():
            value, default = config.value(name), kind().value(name)
            hidden = section not in SHOWN and value == default
            lines += _comment(keys[name].help)
            lines.append(f"{'#' * hidden}{name} = {keys[name].written(value)}")
        if section == "skin":
            for name, several in config.entries().items():
                lines += _entries(name, several, getattr(config, name))
    lines += ["", *_comment("Values of the quick variant, --coarse, instead of those above")]
    lines.append("[coarse]")
    quick = config.coarse()
    lines += [
        f"#{name} = {keys[name].written(quick.value(name))}"
        for name in keys
        if quick.value(name) != config.value(name)
    ]
    return "\n".join(lines) + "\n"


def short_scene_text(kind: type[Scene], names: Mapping[str, str] | None = None) -> str:
    """Return a scene file with the few keys that a new user changes.

    Args:
        kind: The kind.
        names: Names of materials by their roles; without, those of the default numbers.
    """
    config = kind.example()
    lines = _opening(kind, SHORT, kind.EXAMPLE_FILES)
    # The default print is one sheet with the default fabric; on another one it is a layer.
    default = EXAMPLES if "fabric" in (names or {}) else DEFAULTS
    roles = [role for role in DEFAULTS if role in roles_of(config)]
    named = {**{role: default[role] for role in roles}, **(names or {})}
    for section, of in config.tables().items():
        few = [key for key in of.described().values() if key.name in config.FEW]
        if few or (section == TABLE and named):
            lines += ["", *_comment(of.holds()), f"[{section}]"]
        if section == TABLE:
            lines += [f"{role} = {quoted(name)}" for role, name in named.items()]
        for key in few:
            lines += [*_comment(key.help), f"{key.name} = {key.written(config.value(key.name))}"]
        if section == "skin":
            for name, several in config.entries().items():
                lines += _entries(name, several, getattr(config, name))
    return "\n".join(lines) + "\n"


def _opening(kind: type[Scene], text: str, files: Mapping[str, str | Path]) -> list[str]:
    """Return what a file begins with: its kind and its files, after a comment."""
    about = ABOUT[kind.KIND]
    lines = [*_comment(f"{about[0].upper()}{about[1:]}."), *_comment(text), ""]
    lines.append(f'kind = "{kind.KIND}"')
    lines += ["", "[files]"] if kind.files() else []
    for name, text in kind.files().items():
        path = files.get(name)
        lines += _comment(text)
        lines.append(f'#{name} = ""' if path is None else f"{name} = {quoted(str(path))}")
    return lines


def _materials(config: Scene, materials: Mapping[str, LibraryMaterial]) -> list[str]:
    """Return comments on names of materials: those that numbers come from, or how to name any."""
    if not materials:
        names = ", ".join(f"{role} = {quoted(EXAMPLES[role])}" for role in roles_of(config))
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
    """Return the tables of a field that holds several configurations."""
    lines = ["", *_comment(f"{of.holds()}; one table [{name}], or several [[{name}]]")]
    keys = of.described().values()
    for one in keys:
        lines += _comment(f"{one.name}: {one.help}")
    if not values:
        lines.append(f"#[{name}]")
        lines += [f"#{one.name} = {one.written(one.default)}" for one in keys]
    for value in values:
        lines.append(f"[{name}]" if len(values) == 1 else f"[[{name}]]")
        for one in keys:
            own = getattr(value, one.name)
            lines.append(f"{'#' * (own == one.default)}{one.name} = {one.written(own)}")
    return lines


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, WIDTH - 2, break_long_words=False)]
