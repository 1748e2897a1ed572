"""A command of `toros`: a table whose fields are its options."""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import NONE, Key, Table, plain_value

T = TypeVar("T", bound=Table)
METAVARS, QUOTE = {float: "X", int: "N", str: "NAME", Path: "PATH"}, '"'


@dataclass(frozen=True)
class Answer:
    """What a command found: lines for a reader, figures for a program, and an exit code."""

    text: str
    figures: Mapping[str, Any] = field(default_factory=dict)
    code: int = 0


class Command(Table, kw_only=True):
    """Base of the commands of `toros`: each field is an option, and the docstring is the help.

    What solves is imported where the command is called, so that its help comes at once.

    Attributes:
        EXAMPLES: Lines that may be typed.
        WORDS: Fields that are given without their names, in this order.
        TAKES: What the help calls the value of an option, where it is no plain number or name.
        given: Names of the values that were given; all others are defaults.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = ()
    WORDS: ClassVar[tuple[str, ...]] = ()
    TAKES: ClassVar[Mapping[str, str]] = {}

    @classmethod
    def of_given(cls, **values: Any) -> Self:
        """Return a command that knows what was given."""
        made = cls(**values)
        object.__setattr__(made, "given", frozenset(values))
        return made

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Run on all ranks (collective)."""
        raise NotImplementedError

    @classmethod
    def details(cls) -> str:
        """Return what the help says after the first line."""
        return inspect.cleandoc(cls.__doc__ or "").partition("\n")[2].strip()

    def updating(self, settings: T) -> T:
        """Return settings with the values of the options of the same names that were given."""
        known = vars(self)["given"] & settings.described().keys()
        return settings.updated(**{name: getattr(self, name) for name in known})


def add_options(parser: argparse.ArgumentParser, command: type[Command]) -> None:
    """Add the fields of a command, in groups by the table that defines them.

    A value may have a unit, as in files. What is not given is absent from the result.
    """
    groups: dict[type, Any] = {command: parser}
    for one in command.described().values():
        homes = (of for of in reversed(command.__mro__) if issubclass(of, Table))
        home = next(of for of in homes if one.name in vars(of).get("__dataclass_fields__", ()))
        if home not in groups:
            groups[home] = parser.add_argument_group(home.holds())
        word, text = "--" + one.name.replace("_", "-"), _help(one)
        form: dict[str, Any] = {"type": reader(one), "required": one.default is MISSING}
        form["metavar"] = command.TAKES.get(one.name, METAVARS.get(one.kind))
        if one.name in command.WORDS:
            several = "+" if one.several else None if one.default is MISSING else "?"
            word, form = one.name, {"type": reader(one), "nargs": several}
            form["metavar"] = one.name.upper()
        elif one.kind is bool:
            form = {"action": "store_true"}
        elif one.several:
            form["action"] = "append"
        groups[home].add_argument(word, default=argparse.SUPPRESS, help=text, **form)


def _help(one: Key) -> str:
    """Return the help of an option of a command; what none stands for is told as its default."""
    if one.default is MISSING:
        return one.help.replace("%", "%%")
    if one.kind is bool:
        return f"{one.meaning}; default no"
    if one.default not in (None, "") and not one.several:
        return option_help(one, one.default)
    about, _, none = re.sub("; none takes ", "; none: ", one.meaning).partition("; none: ")
    text = replace(one, meaning=about, optional=False).help
    return f"{text}; default {none or NONE}".replace("%", "%%")


def option_help(one: Key, default: Any) -> str:
    """Return the help of a key as an option."""
    shown = {True: "yes", False: "no"}.get(default) if one.kind is bool else None
    return f"{one.help}; default {shown or one.written(default).strip(QUOTE)}".replace("%", "%%")


def reader(one: Key) -> Callable[[str], Any]:
    """Return what reads a value of a key, or one of several, from a word of a command line."""

    def read(text: str) -> Any:
        try:
            return one.one.read(text if one.kind in (str, Path) else plain_value(text))
        except ParameterError as caught:
            raise argparse.ArgumentTypeError(str(caught)) from None

    return read
