"""Line of each key of a TOML file: the standard library's reader does not tell it."""

from __future__ import annotations

import re
from collections.abc import Mapping

Place = tuple[str | int, ...]

_PART = r"(?:[A-Za-z0-9_-]+|\"(?:[^\"\\]|\\.)*\"|'[^']*')"
_DOTTED = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*(\[\[?)\s*({_DOTTED})\s*\]")
_KEY = re.compile(rf"\s*({_DOTTED})\s*=")


def key_lines(text: str) -> dict[Place, int]:
    """Return the line, from 1, of each table and key of a valid TOML text.

    A place is the keys that lead to it; an array of tables adds the number of the table, from 0.
    Keys inside inline tables are left out: `line_of` takes the line of these.
    """
    found: dict[Place, int] = {}
    counts: dict[Place, int] = {}
    table: Place = ()
    open_string, depth = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        rest = line
        if not open_string and depth == 0:
            header, key = _HEADER.match(line), _KEY.match(line)
            if header is not None:
                table = _parts(header.group(2))
                if header.group(1) == "[[":
                    counts[table] = counts.get(table, -1) + 1
                    table = (*table, counts[table])
                found.setdefault(table, number)
                continue
            if key is None:
                continue
            parts = _parts(key.group(1))
            for end in range(1, len(parts) + 1):  # a.b = 1 makes the table a too
                found.setdefault((*table, *parts[:end]), number)
            rest = line[key.end() :]
        open_string, depth = _after(rest, open_string, depth)
    return found


def line_of(lines: Mapping[Place, int], place: Place) -> int | None:
    """Return the line of a place, or of the table around it; None if neither is known."""
    for end in range(len(place), 0, -1):
        if place[:end] in lines:
            return lines[place[:end]]
    return None


def _parts(dotted: str) -> Place:
    return tuple(part.strip("\"'") for part in re.findall(_PART, dotted))


def _after(line: str, open_string: str, depth: int) -> tuple[str, int]:
    """Return which multi-line string is open after a piece of text, and how many brackets are."""
    k = 0
    while k < len(line):
        if open_string:
            if open_string in ('"', '"""') and line[k] == "\\":
                k += 2
            elif line.startswith(open_string, k):
                k += len(open_string)
                open_string = ""
            else:
                k += 1
            continue
        if line[k] == "#":
            break
        for quote in ('"""', "'''", '"', "'"):
            if line.startswith(quote, k):
                open_string = quote
                break
        k += len(open_string) or 1
        if not open_string:
            depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(line[k - 1], 0)
    return (open_string if len(open_string) == 3 else ""), depth
