"""Line of each key of a TOML file: the standard library's reader does not tell it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

Place = tuple[str | int, ...]
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


_WORD = r"(?:\"[^\"]*\"|'[^']*'|[^\s.=\"'#\[\]{},]+)"
_CHAIN = re.compile(rf"{_WORD}(?:[ \t]*\.[ \t]*{_WORD})*")


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
