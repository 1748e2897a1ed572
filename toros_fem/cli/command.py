"""A command of `toros`: a table whose fields are its options."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

from cyclopts import Group, Parameter
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import NONE, Key, Table, plain_value
from toros_fem.cli.process import UsageError

T = TypeVar("T", bound=Table)
METAVARS, QUOTE = {float: "X", int: "N", str: "NAME", Path: "PATH"}, '"'
OUTPUT = Group("Output of the command")
# The groups of what a command defines itself: its options, and what is given without a name.
OWN = "Parameters", "Arguments"


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
    def of_words(cls, given: Mapping[str, Any]) -> Self:
        """Return a command from the words of a command line, by the names of its fields.

        A UsageError tells all that are wrong.
        """
        keys, values, wrong = cls.described(), {}, []
        for name, words in given.items():
            one = keys[name]
            try:
                values[name] = words if one.kind is bool else _read(one, words)
            except ParameterError as caught:
                wrong.append(str(caught))
        if wrong:
            raise UsageError("\n".join(f"toros {cls.__name__.lower()}: {one}" for one in wrong))
        made = cls(**values)
        object.__setattr__(made, "given", frozenset(values))
        return made

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Run on all ranks (collective)."""
        raise NotImplementedError

    @classmethod
    def signature(cls) -> inspect.Signature:
        """Return the words that it takes: those without names first, then its options by groups.

        A group is what one table defines. The words are read by `of_words`, with their units.
        """
        keys = cls.described()
        words = [_parameter(cls, keys[name]) for name in cls.WORDS]
        options = [_parameter(cls, one) for name, one in keys.items() if name not in cls.WORDS]
        more = [
            _flag("json", "print the result as JSON on stdout, and all else on stderr; default no"),
            _flag("quiet", "no progress, only warnings; default no"),
        ]
        return inspect.Signature([*words, *options, *more])

    def updating(self, settings: T) -> T:
        """Return settings with the values of the options of the same names that were given."""
        known = vars(self)["given"] & settings.described().keys()
        return settings.updated(**{name: getattr(self, name) for name in known})


def _read(one: Key, words: Any) -> Any:
    """Return the value of a key, or its values, from words of a command line."""
    if one.several:
        return tuple(_read(one.one, word) for word in words)
    return one.read(words if one.kind in (str, Path) else plain_value(words))


def _parameter(command: type[Command], one: Key) -> inspect.Parameter:
    """Return a word that a command takes as cyclopts sees it: a text that is not read yet."""
    word: Any = bool if one.kind is bool else Path if one.kind is Path else str
    homes = (of for of in reversed(command.__mro__) if issubclass(of, Table))
    home = next(of for of in homes if one.name in vars(of).get("__dataclass_fields__", ()))
    alone = one.name in command.WORDS
    about = Parameter(
        help=_help(one),
        metavar=None if alone else command.TAKES.get(one.name, METAVARS.get(one.kind)),
        choices=one.words or None,
        converter=None if one.kind is bool else _several if one.several else _first,
        group=OWN[alone] if home is command else Group(home.holds()),
    )
    kind = inspect.Parameter.POSITIONAL_ONLY if alone else inspect.Parameter.KEYWORD_ONLY
    default = inspect.Parameter.empty if one.default is MISSING else None
    hint: Any = tuple[word, ...] if one.several else word
    hint = Annotated[hint if one.default is MISSING else hint | None, about]
    return inspect.Parameter(one.name, kind, default=default, annotation=hint)


def _flag(name: str, text: str) -> inspect.Parameter:
    hint = Annotated[bool, Parameter(help=text, group=OUTPUT)]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=hint)


def _first(of: Any, tokens: Any) -> str:
    return str(tokens[0].value)


def _several(of: Any, tokens: Any) -> tuple[str, ...]:
    return tuple(token.value for token in tokens)


def _help(one: Key) -> str:
    """Return the help of an option of a command; what none stands for is told as its default."""
    if one.default is MISSING:
        return one.help
    if one.kind is bool:
        return f"{one.meaning}; default no"
    if one.default not in (None, "") and not one.several:
        return f"{one.help}; default {one.written(one.default).strip(QUOTE)}"
    about, _, none = re.sub("; none takes ", "; none: ", one.meaning).partition("; none: ")
    return f"{replace(one, meaning=about, optional=False).help}; default {none or NONE}"
