"""Scenes: all numbers of a design or a simulation, in tables by subject; their TOML files."""

from __future__ import annotations

import functools
import re
import tomllib
import typing
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, NoReturn, Self, TypeVar

from mpi4py import MPI
from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.files import read_bytes
from toros_fem.base.keys import Key, Need, Table, nearest, refusal_of
from toros_fem.base.mpi import require_comm
from toros_fem.base.validation import shown

# Order of tables in files.
ORDER = (
    "target", "object", "skin", "held", "printed", "plain", "material", "pressure", "load",
    "contact", "pull", "objective", "metric", "design", "lines", "print", "results",
)  # fmt: skip
# Marks a field of a scene that is no table of its file.
NO_TABLE: Mapping[str, bool] = MappingProxyType({"outside": True})
T = TypeVar("T")
# The keys that lead to a value, and the numbers of tables that stand several times, from 0.
Place = tuple[str | int, ...]
# Characters of a key that a message shows, and most errors that it tells.
LONGEST, MOST = 100, 20
# Most parts of a dotted key: the time and memory of the standard library's reader go by the square.
DEEPEST = 32
_PART = r"(?:[A-Za-z0-9_-]+|\"(?:[^\"\\]|\\.)*\"|'[^']*')"
_DOTTED = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"[ \t]*(\[\[?)\s*({_DOTTED})\s*\]")
_KEY = re.compile(rf"[ \t]*({_DOTTED})\s*=")
# What decides where a statement ends: brackets and line ends outside of strings and comments.
_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\])*"|\'[^\']*\'|#[^\n]*|[][{}\n]',
    re.DOTALL,
)
# Parts of a key that stand in a chain, in a text that need not be TOML.
_WORD = r"(?:\"[^\"]*\"|'[^']*'|[^\s.=\"'#\[\]{},]+)"
_CHAIN = re.compile(rf"{_WORD}(?:[ \t]*\.[ \t]*{_WORD})*")


class Scene(Table):
    """Base of all scenes: each field is a table of the file, or a tuple of tables of one type.

    A key stands in one table only, so that its name is enough where values are given.

    Attributes:
        FEW: Keys that a new user changes.
        COARSE: Factors of the quick variant, by key.
        DESIGN_FILES, SIMULATION_FILES: Files or folders that a design or a simulation can take, by
            name, with their help.
        EXAMPLE_FILES: Files that a new scene file names.
        OUTLINE: Keys by the words of an `OutlineError` that they are given as.
        NEEDS: What keys need to count in scenes of this kind; tables may have it for their own.
    """

    KIND: ClassVar[str] = ""
    FEW: ClassVar[tuple[str, ...]] = ()
    COARSE: ClassVar[Mapping[str, float]] = {}
    DESIGN_FILES: ClassVar[Mapping[str, str]] = {}
    SIMULATION_FILES: ClassVar[Mapping[str, str]] = {}
    EXAMPLE_FILES: ClassVar[Mapping[str, str]] = {}
    OUTLINE: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[Mapping[str, Need]] = {}

    @classmethod
    def example(cls) -> Self:
        """Return what a new scene file holds: the defaults, if a kind says nothing else."""
        return cls()

    @classmethod
    def pose_keys(cls) -> dict[str, Key]:
        """Return the keys that a further pose may have, by name; none where there are none."""
        return {}

    @classmethod
    def files(cls) -> dict[str, str]:
        """Return the files that a design or a simulation can take, with their help."""
        return {**cls.DESIGN_FILES, **cls.SIMULATION_FILES}

    def of_first_rank(self, comm: MPI.Comm) -> Self:
        """Return the scene of the first rank, whatever the others have (collective)."""
        require_comm(comm)
        return self if comm.size == 1 else comm.bcast(self, root=0)

    def with_files(self, comm: MPI.Comm, files: Mapping[str, Path]) -> Self:
        """Return the scene with what its files hold, by the names in `DESIGN_FILES` (collective).

        Most scenes need none. A TorosError says that one cannot be read, or does not fit.
        """
        del comm, files
        return self

    def groups(self) -> Iterator[Any]:
        """Yield the groups of the scene that are known, of `products.common.plausibility`."""
        return iter(())

    @classmethod
    def needs(cls) -> dict[str, Need]:
        """Return what keys need to count, by name."""
        own = [getattr(of, "NEEDS", {}) for of in (*cls.tables().values(), cls)]
        return {name: need for of in own for name, need in of.items()}

    def idle(self) -> Iterator[tuple[str, Need]]:
        """Yield the keys that do not count, and what they need; not those left at a default."""
        needs, plain = self.needs(), type(self)()
        left = (plain, plain.coarse()) if needs else ()
        for name, (other, needed) in needs.items():
            value = self.value(other)
            counts = value in needed if needed else value is not None
            if not counts and self.value(name) not in [one.value(name) for one in left]:
                yield name, (other, needed)

    def coarse(self) -> Self:
        """Return the quick variant, a coarse mesh and few steps: values times `COARSE`."""
        return self.updated(**self.coarse_values())

    def coarse_values(self) -> dict[str, Any]:
        """Return the values of the quick variant by key: as many steps as each key needs."""
        known, found = self.described(), dict[str, Any]()
        for key, factor in self.COARSE.items():
            value, least = self.value(key), known[key].within.at_least
            if isinstance(value, int) and value > 0:
                found[key] = max(1, least, round(factor * value))
            elif value:  # what is left out stays so
                found[key] = round(factor * value, 9)
        return found

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Return a scene with other values than the defaults, by the names of keys."""
        return cls().updated(**values)

    @classmethod
    def _layout(cls) -> _Layout:
        return _layout_of(cls)  # type: ignore[arg-type]

    @classmethod
    def tables(cls) -> Mapping[str, type[Table]]:
        """Return the type of each table that stands once, by its name, in the order of files."""
        return cls._layout().once

    @classmethod
    def entries(cls) -> Mapping[str, type[Table]]:
        """Return the type of each table that may stand several times, by its name."""
        return cls._layout().several

    @classmethod
    def _own_keys(cls) -> dict[str, Key]:
        """Return its tables, as keys."""
        hints = typing.get_type_hints(cls)
        once = {n: Key(n, hints[n], of, of.holds()) for n, of in cls.tables().items()}
        several = {
            name: Key(name, hints[name], of, of.holds(), several=True)
            for name, of in cls.entries().items()
        }
        return once | several

    @classmethod
    def described(cls) -> dict[str, Key]:
        """Return what is known of each key, by name, of the tables that stand once."""
        return {name: key for of in cls.tables().values() for name, key in of.described().items()}

    @classmethod
    def table_of(cls, key: str) -> str:
        """Return the name of the table that a key stands in."""
        return cls._layout().homes[key]

    def updated(self, **changes: Any) -> Self:
        """Return a copy with other values, by the names of their keys, or whole tables by theirs.

        Raises:
            ParameterError: A name is unknown, or a value is out of its bounds.
        """
        layout, own = self._layout(), {one.name for one in fields(self)}
        whole, by_table = dict[str, Any](), dict[str, dict[str, Any]]()
        for name, value in changes.items():
            if name in own and (isinstance(value, Table) or name in layout.several):
                whole[name] = value
            elif name in layout.homes:
                by_table.setdefault(layout.homes[name], {})[name] = value
            else:
                advice = nearest(name, layout.homes)
                raise ParameterError(f"unknown parameter {name!r}; {advice}", name)
        for table, values in by_table.items():
            whole[table] = whole.get(table, getattr(self, table)).updated(**values)
        return super().updated(**whole)

    def as_dict(self) -> dict[str, Any]:
        """Return all values by the names of their keys, as summaries hold them."""
        several = {name: [asdict(one) for one in getattr(self, name)] for name in self.entries()}
        return {**{name: self.value(name) for name in self.described()}, **several}

    def fixed_and_free(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the values by key that tell a run from others, and those that may change."""
        values, known = self.as_dict(), self.described()
        free = {key: values.pop(key) for key in known if known[key].free}
        return values, free

    def value(self, name: str) -> Any:
        """Return the value of a key of a table that stands once."""
        return getattr(getattr(self, self.table_of(name)), name)


@dataclass(frozen=True)
class _Layout:
    """Types of the tables that stand once and of the others, and the table of each key."""

    once: Mapping[str, type[Table]]
    several: Mapping[str, type[Table]]
    homes: Mapping[str, str]


@functools.cache
def _layout_of(scene: type[Scene]) -> _Layout:
    """Return the layout of a type of scenes; a TypeError where a key stands in two tables."""
    hints = typing.get_type_hints(scene)
    tables = [one.name for one in fields(scene) if not one.metadata.get("outside")]
    parts = {name: typing.get_args(hints[name]) for name in sorted(tables, key=ORDER.index)}
    once = {name: hints[name] for name, of in parts.items() if not of}
    several = {name: of[0] for name, of in parts.items() if of}
    keys = [(key, name) for name, of in once.items() for key in of.described()]
    if len(dict(keys)) < len(keys):
        raise TypeError(f"{scene.__name__} has a key in two tables: {keys}.")
    return _Layout(once, several, dict(keys))


# ------------------------------------------------------------------------------------- TOML files


class Document:
    """A TOML file that was parsed, with the line of each place, from 1.

    A FileError says that the text is no TOML, or a key has too many parts.
    """

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        if line := too_deep(text):
            raise FileError(f"{at(path, line)}: a key has more than {DEEPEST} parts.", path, line)
        try:
            self.content: dict[str, Any] = tomllib.loads(text)
        except RecursionError:
            raise FileError(f"{path}: tables and lists are nested too deeply.", path) from None
        except ValueError as caught:  # an overlong number is no TOMLDecodeError
            why, _, place = str(caught).rpartition(" (at ")
            found = re.match(r"line (\d+)", place)
            line = int(found[1]) if found else text.count("\n") + 1 if why else None
            written = text.split("\n")[line - 1] if line else ""
            if re.match(r"Cannot (overwrite|declare|mutate)", why):
                advice = "this key or table stands in the file already. Keep one of them."
            elif comma := re.search(r"=\s*([-+]?\d+),(\d+)", written):
                advice = f"a number has a comma. Write a point: {comma[1]}.{comma[2]}"
            else:
                advice = (
                    f"{why or place}: this is no TOML. Text needs quotes, and so do values with "
                    'units, as in "5 kPa".'
                )
            raise FileError(f"{at(path, line)}: {advice}", path, line) from None
        self.lines = key_lines(text)

    def failed(self, place: Place, message: str) -> FileError:
        """Return the error of a key, or of the whole file where the place is empty."""
        line, key = line_of(self.lines, place), ".".join(map(str, place))
        cut = f"{key[:LONGEST]}{'…' * (len(key) > LONGEST)}"
        message = f"{cut if cut.isprintable() else ascii(cut)}: {message}" if key else message
        return FileError(f"{at(self.path, line)}: {message}", self.path, line, key or None)

    def fail(self, place: Place, message: str) -> NoReturn:
        """Raise the error of a place."""
        raise self.failed(place, message) from None

    def advice(self, place: Place, name: str, known: Collection[str]) -> str:
        """Return the advice for an unknown word: the nearest known one."""
        return nearest(name, known)

    def values(
        self, of: TypeAdapter[dict[str, Any]], tables: Mapping[str, Mapping[str, Key]]
    ) -> dict[str, Any]:
        """Return the values of all tables, of those that are given; errors of all are told at once.

        Args:
            of: Type of the content.
            tables: Keys of each table.
        """
        try:
            return of.validate_python(self.content)
        except ValidationError as caught:
            self.fail_for([self.wrong(one, tables) for one in caught.errors(include_url=False)])

    def wrong(self, error: ErrorDetails, tables: Mapping[str, Mapping[str, Key]]) -> FileError:
        """Return an error of the content as that of its place."""
        first, *inner = error["loc"]
        table = str(first)
        number = [inner.pop(0)] if inner and isinstance(inner[0], int) else []
        if isinstance(self.content[table], dict):  # [held] is one of what may stand several times
            number = []
        place = (table, *number, *inner[:1])
        if error["type"] == "extra_forbidden":
            known = tables[table] if inner else tables
            word = "key" if inner or not isinstance(error["input"], dict | list) else "table"
            return self.failed(place, self.unknown(place, word, known))
        if not inner:
            advice = f": write [{table}], and its keys in lines below"
            if error["type"] == "list_type" or number:
                advice = f" [{table}], or several [[{table}]]"
            return self.failed((table,), f"must be a table{advice}.")
        return self.failed(place, str(refusal_of(tables[table], tuple(inner), error)))

    def unknown(self, place: Place, word: str, known: Collection[str]) -> str:
        """Return what to say of an unknown key, or another word, and the nearest known one."""
        name = str(place[-1])
        return f"unknown {word} {shown(name)}; {self.advice(place, name, known)}"

    def fail_for(self, errors: list[FileError]) -> NoReturn:
        """Raise all errors as one, in the order of their lines."""
        errors.sort(key=lambda one: one.line or 0)
        told = [str(one) for one in errors[:MOST]]
        if errors[MOST:]:
            told.append(f"{len(errors) - MOST} more are wrong.")
        first = errors[0]
        raise FileError("\n".join(told), first.path, first.line, first.key) from None

    def made(self, of: Callable[..., T], at: Place, values: Mapping[str, Any]) -> T:
        """Return what the values of a table make; a value that fits no other is told by its key."""
        try:
            return of(**values)
        except ParameterError as caught:
            self.fail((*at, str(caught.key)) if caught.key in values else at, str(caught))


def at(path: Path, line: int | None) -> str:
    """Return a place in a file in words; the line may not be known."""
    return f"{path}" if line is None else f"{path}, line {line}"


def read_text(
    path: Path,
    what: str,
    size: str = "keys",
    decoded: Callable[[bytes], str] = lambda content: content.decode("utf-8-sig"),
) -> str:
    """Return the text of a file: `what`, "a scene file" for instance, of a size in `MOST_BYTES`.

    Raises:
        FileError: The file cannot be read, is too long, or is no UTF-8.
    """
    try:
        content = read_bytes(path, size)
    except IsADirectoryError:
        raise FileError(f"{path} is a folder; name {what}.", path) from None
    except FileNotFoundError:
        raise FileError(f"there is no {path}. Check its path.", path) from None
    except (OSError, ValueError) as caught:  # a path with a null character is a ValueError
        advice = "Check the path" if isinstance(caught, OSError) else f"It is not {what}"
        raise FileError(f"{path} cannot be read: {caught}. {advice}.", path) from None
    try:
        return decoded(content).replace("\r\n", "\n")
    except UnicodeDecodeError as caught:
        line = content.count(b"\n", 0, caught.start) + 1
        message = f"{at(path, line)}: no UTF-8 text. Save it as UTF-8."
        raise FileError(message, path, line) from None


def too_deep(text: str) -> int | None:
    """Return the first line, from 1, with a chain of too many parts; None without."""
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") >= DEEPEST and any(
            len(re.findall(_WORD, chain[0])) > DEEPEST for chain in _CHAIN.finditer(line)
        ):
            return number
    return None


def key_lines(text: str) -> dict[Place, int]:
    """Return the line, from 1, of each table and key of a valid TOML text.

    A place is the keys that lead to it; an array of tables adds the number of the table, from 0.
    Keys inside inline tables are left out: `line_of` takes the line of these.
    """
    found: dict[Place, int] = {}
    counts: dict[Place, int] = {}
    table: Place = ()
    for number, begin in _statements(text):
        if header := _HEADER.match(text, begin):
            table = _parts(header[2])
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            found.setdefault(table, number)
        elif key := _KEY.match(text, begin):
            parts = _parts(key[1])
            for end in range(1, len(parts) + 1):  # a.b = 1 makes the table a too
                found.setdefault((*table, *parts[:end]), number)
    return found


def line_of(lines: Mapping[Place, int], place: Place) -> int | None:
    """Return the line of a place, or of the table around it; None if neither is known."""
    around = (place[:end] for end in range(len(place), 0, -1))
    return next((lines[one] for one in around if one in lines), None)


def _parts(dotted: str) -> Place:
    return tuple(part.strip("\"'") for part in re.findall(_PART, dotted))


def _statements(text: str) -> Iterator[tuple[int, int]]:
    """Yield number and begin of each line that goes on with no value of the line before."""
    number, depth = 1, 0
    yield number, 0
    for token in _TOKEN.finditer(text):
        number += token[0].count("\n")
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(token[0], 0)
        if token[0] == "\n" and depth == 0:
            yield number, token.end()
