"""Words that a person types: commands, options and keys, each with what is said about it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import NoneType
from typing import Any, get_args, get_origin

from toros_fem.base.scene import Scene
from toros_fem.cli.commands.main import COMMANDS, application, command_of, overview
from toros_fem.cli.process import MEANING
from toros_fem.cli.scene_files import LIBRARY, MATERIAL, names_of
from toros_fem.products.kinds import ABOUT, KINDS


def plain(text: str | None) -> str:
    """Return a text on one line."""
    return " ".join((text or "").split())


def options(name: str) -> Iterator[tuple[str, Any]]:
    """Yield each option and argument of a command by the word for it, as cyclopts sees it."""
    for one in application(name)[name].assemble_argument_collection():
        alone = one.field_info.kind is one.field_info.POSITIONAL_ONLY
        yield one.field_info.name.upper() if alone else one.name, one


def taken(one: Any) -> str:
    """Return what an option takes."""
    kind = next(of for of in (get_args(one.hint) or (one.hint,)) if of is not NoneType)
    kind = one.hint if get_origin(one.hint) is tuple else kind
    parts = ["no value" if kind is bool else f"takes {one.parameter.metavar or one.name.upper()}"]
    if one.parameter.choices:
        parts.append("one of " + ", ".join(one.parameter.choices))
    if one.required:
        parts.append("required")
    if get_origin(kind) is tuple:
        parts.append("may be repeated")
    return "; ".join(parts)


def test_commands(pinned: Callable[..., None]) -> None:
    """Each command with its options; the exit codes with their meaning."""
    found = {f"toros {name} {word}": taken(one) for name in COMMANDS for word, one in options(name)}
    pinned("commands", {**found, **{f"exit code {code}": text for code, text in MEANING.items()}})


def test_help_texts(pinned: Callable[..., None]) -> None:
    """What `--help` says about each command, and about each of its options."""
    found: dict[str, Any] = {"toros": plain(overview())}
    for name in COMMANDS:
        found[f"toros {name}"] = plain(command_of(name).__doc__)
        found[f"toros {name}: examples"] = list(command_of(name).EXAMPLES)
        found |= {f"toros {name} {word}": plain(one.parameter.help) for word, one in options(name)}
    pinned("help_texts", found)


def keys(kind: type[Scene]) -> Iterator[tuple[str, str]]:
    """Yield each key of a kind's scene files, and what is said about it."""
    yield kind.KIND, ABOUT[kind.KIND]
    for name, text in kind.files().items():
        example = kind.EXAMPLE_FILES.get(name)
        yield f"{kind.KIND} [files] {name}", f"{text}; in a new file {example or 'none'}"
    config, quick = kind(), kind().coarse()
    roles = names_of(kind)
    if roles:
        yield f"{kind.KIND} [files] {LIBRARY}", "a file of materials"
    for role in roles:
        yield f"{kind.KIND} [{MATERIAL}] {role}", "a material by name"
    for section, of in config.tables().items():
        for name in of.described():
            text = said(config, name)
            for where, other in (("coarse", quick), ("in a new file", kind.example())):
                if other.value(name) != config.value(name):
                    text += f"; {where} {said(other, name).rpartition('default ')[2]}"
            yield f"{kind.KIND} [{section}] {name}", text
    for table, of in config.entries().items():
        yield f"{kind.KIND} [{table}]", of.holds()
        for name in of.described():
            yield f"{kind.KIND} [{table}] {name}", said(of, name)


def said(config: Any, name: str) -> str:
    """Return type, meaning, unit, bounds and default of a key."""
    one = config.described()[name]
    default = config.value(name) if isinstance(config, Scene) else one.default
    shown = {True: "yes", False: "no"}.get(default) if one.kind is bool else None
    told = shown or one.written(default).strip('"')
    return f"{one.kind.__name__}: {one.help}; default {told}"


def test_scene_keys(pinned: Callable[..., None]) -> None:
    """Each table and key of a scene file: type, meaning, unit, bounds, default, quick variant."""
    pinned("scene_keys", {key: text for kind in KINDS.values() for key, text in keys(kind)})
