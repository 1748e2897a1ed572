"""The command line of scripts: every field of a configuration is an option of its own."""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from mpi4py import MPI

from toros_fem.config import Config
from toros_fem.errors import TorosError

C = TypeVar("C", bound=Config)


class _Parser(argparse.ArgumentParser):
    """A parser that answers an unknown option by the nearest known one."""

    def error(self, message: str) -> NoReturn:
        unknown = message.partition("unrecognized arguments: ")[2].split()
        known = [flag for action in self._actions for flag in action.option_strings]
        near = difflib.get_close_matches(unknown[0], known, n=1) if unknown else []
        super().error(f"{message}; did you mean {near[0]}?" if near else message)


def run_from_command_line(
    comm: MPI.Comm,
    about: str,
    config: C,
    run: Callable[..., dict[str, Any]],
    output: Path,
    *,
    coarse: Callable[[C], C] | None = None,
    sentence: Callable[[dict[str, Any]], str],
    files: dict[str, str] | None = None,
    arguments: dict[str, str] | None = None,
) -> int:
    """Run a script with the values that the command line gives; return the exit code.

    Args:
        comm: Communicator.
        about: Help text.
        config: The configuration with its defaults.
        run: `run(comm, output, config, verbose=…)`, and what `files` names; returns the summary.
        output: Default folder.
        coarse: Makes the quick variant that `--coarse` asks for; None for none. Values given
            beside it come on top.
        sentence: Returns the result in a sentence, from the summary.
        files: Further options that name a file or folder, with their help; by default None.
        arguments: Files that are named without an option, in this order, with their help; those
            left out are None.
    """
    parser = _Parser(
        description=about,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    if coarse is not None:
        parser.add_argument("--coarse", action="store_true", help="a small mesh and few steps")
    parser.add_argument("--verbose", action="store_true", help="print details, such as every Newton step")
    parser.add_argument("--output", type=Path, default=output, help=f"folder; default {output}")
    for name, text in (files or {}).items():
        parser.add_argument(f"--{name}", type=Path, default=None, help=text, metavar="PATH")
    for name, text in (arguments or {}).items():
        parser.add_argument(name, type=Path, nargs="?", default=None, help=text)
    add_options(parser, config)
    given = vars(parser.parse_args())
    folder, verbose = given.pop("output"), given.pop("verbose")
    small = given.pop("coarse", False)
    paths = {name: given.pop(name) for name in (*(files or {}), *(arguments or {}))}
    values = {name: value for name, value in given.items() if value is not _UNSET}

    def action() -> str:
        start = coarse(config) if small and coarse is not None else config
        summary = run(comm, folder, start.updated(**values), verbose=verbose, **paths)
        return f"{sentence(summary)}; see {folder}/"

    return run_guarded(comm, action)


_UNSET = object()


def add_options(parser: argparse.ArgumentParser, config: Config) -> None:
    """Add an option for each field: its meaning, unit, default and bounds are its help."""
    for name, (kind, optional) in config.kinds().items():
        spec, default = config.quantity(name), getattr(config, name)
        unit = f" in {spec.unit}" if spec.unit else ""
        bounds = f"; {spec.bounds}" if spec.bounds else ""
        shown = f"{default:g}" if isinstance(default, float) else str(default).lower()
        if kind is str:
            shown = str(default)
        text = f"{spec.meaning}{unit}{bounds}{' or none' if optional else ''}; default {shown}"
        flag = "--" + name.replace("_", "-")
        text = text.replace("%", "%%")
        if kind is bool:
            parser.add_argument(
                flag, action=argparse.BooleanOptionalAction, default=_UNSET, help=text
            )
            continue
        parser.add_argument(
            flag,
            type=_reader(kind, optional=optional),
            default=_UNSET,
            help=text,
            metavar={float: "X", int: "N", str: "NAME"}[kind],
        )


def _reader(kind: type, *, optional: bool) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        return None if optional and text.lower() == "none" else kind(text)

    read.__name__ = {float: "number", int: "whole number", str: "word"}[kind]  # argparse shows it
    return read


def run_guarded(comm: MPI.Comm, action: Callable[[], str]) -> int:
    """Print the text that an action returns, or its error in one line; return the exit code."""
    try:
        text = action()
    except TorosError as error:
        if comm.rank == 0:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 2
    if comm.rank == 0:
        print(text)
    return 0
