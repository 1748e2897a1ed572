"""TOML files, read strictly: line of each key, values with units, errors that name the place."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.files import read_bytes
from toros_fem.base.keys import Key, nearest, refusal_of
from toros_fem.base.validation import shown

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
