"""Meaning and unit of every column of the tables and of every key of the JSON files of a run."""

from __future__ import annotations

import csv
from fnmatch import fnmatchcase
from functools import cache
from importlib import resources
from typing import NamedTuple


class Column(NamedTuple):
    """A row of columns.csv.

    Attributes:
        key: Name of the column; of JSON also with dots, and with `*` for any name.
        unit: Its unit; empty for a text, a yes or no, or a number of things.
        meaning: What it is.
    """

    key: str
    unit: str
    meaning: str


@cache
def columns() -> tuple[Column, ...]:
    """Return all columns."""
    path = resources.files("toros_fem.results").joinpath("columns.csv")
    rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
    next(rows)
    return tuple(Column(*row) for row in rows)


def column(key: str) -> Column | None:
    """Return what is said of a column, or of a key of JSON with dots; None if nothing is.

    A row of exactly this key counts before one of its last part, and both before patterns.
    """
    last, known = key.rpartition(".")[2], {row.key: row for row in columns()}
    if key in known or last in known:
        return known.get(key, known.get(last))
    dotted = [row for row in columns() if "." in row.key and fnmatchcase(key, row.key)]
    plain = [row for row in columns() if "." not in row.key and fnmatchcase(last, row.key)]
    return next(iter(dotted + plain), None)
