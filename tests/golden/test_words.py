"""Words that a person types: commands, options and keys, each with what is said about it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest
from mpi4py import MPI

from toros_fem.base.scene import Scene
from toros_fem.cli.command_line.command import option_help
from toros_fem.cli.command_line.exit_codes import MEANING
from toros_fem.cli.commands.main import COMMANDS, run
from toros_fem.cli.scene_files.layout import LIBRARY, MATERIAL
from toros_fem.cli.scene_files.materials import names_of
from toros_fem.products.kinds import ABOUT, KINDS


@pytest.fixture
def parser_of(monkeypatch: pytest.MonkeyPatch) -> Callable[..., argparse.ArgumentParser]:
    """Return the parser that a program reads its words with; it is stopped there."""
    found: list[argparse.ArgumentParser] = []

    def stop(parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        found.append(parser)
        raise SystemExit

    def parser(program: Callable[..., object], *arguments: Any, **named: Any) -> Any:
        with suppress(SystemExit):
            program(*arguments, **named)
        return found[-1]

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
    return parser


def plain(text: str | None) -> str:
    """Return a text on one line."""
    return " ".join((text or "").split())


def options(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.Action]]:
    """Yield each option and argument of a parser by the word for it."""
    for action in parser._actions:
        if not isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            yield ", ".join(action.option_strings) or str(action.metavar or action.dest), action


def taken(action: argparse.Action) -> str:
    """Return what an option takes, as far as its parser knows."""
    parts = ["no value" if action.nargs == 0 else f"takes {action.metavar or action.dest}"]
    if action.choices is not None:
        parts.append("one of " + ", ".join(map(str, action.choices)))
    if action.required:
        parts.append("required")
    if action.default not in (None, argparse.SUPPRESS):
        parts.append(f"default {action.default}")
    if isinstance(action, argparse._AppendAction):
        parts.append("may be repeated")
    return "; ".join(parts)


def helps(name: str, parser: argparse.ArgumentParser) -> dict[str, str]:
    """Return the help of each option of a program, by program and option."""
    return {f"{name} {word}": plain(action.help) % vars(action) for word, action in options(parser)}


def commands(parser_of: Callable[..., Any]) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield the parser of each command."""
    toros = parser_of(run, MPI.COMM_SELF, [])
    (found,) = (a for a in toros._actions if isinstance(a, argparse._SubParsersAction))
    yield from found.choices.items()


def test_commands(parser_of: Callable[..., Any], pinned: Callable[..., None]) -> None:
    """Each command with its options; the exit codes with their meaning."""
    toros = parser_of(run, MPI.COMM_SELF, [])
    found = {f"toros {word}": taken(action) for word, action in options(toros)}
    for name, parser in commands(parser_of):
        found |= {f"toros {name} {word}": taken(action) for word, action in options(parser)}
    pinned("commands", {**found, **{f"exit code {code}": text for code, text in MEANING.items()}})


def test_help_texts(parser_of: Callable[..., Any], pinned: Callable[..., None]) -> None:
    """What `--help` says about each command, and about each of its options."""
    toros = parser_of(run, MPI.COMM_SELF, [])
    found: dict[str, Any] = {"toros": plain(toros.description), **helps("toros", toros)}
    for name, parser in commands(parser_of):
        found[f"toros {name}"] = plain(parser.description)
        found[f"toros {name}: examples"] = list(COMMANDS[name].EXAMPLES)
        found |= helps(f"toros {name}", parser)
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
    return f"{one.kind.__name__}: {option_help(one, default).replace('%%', '%')}"


def test_scene_keys(pinned: Callable[..., None]) -> None:
    """Each table and key of a scene file: type, meaning, unit, bounds, default, quick variant."""
    pinned("scene_keys", {key: text for kind in KINDS.values() for key, text in keys(kind)})
