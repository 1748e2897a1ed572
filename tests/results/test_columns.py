"""Every column and key that a run writes is described, with its files and the unit of its name."""

import csv
from collections import defaultdict
from fnmatch import fnmatchcase
from typing import NamedTuple

from helpers.scenes import ROOT
from kit.pin import GOLDEN

ENDINGS = {"n_per_m": "N/m", "n_m": "N m", "deg": "deg", "mm": "mm", "mm2": "mm²", "m3": "m³",
           "m2": "m²", "m": "m", "pa": "Pa", "n": "N", "kg": "kg", "j": "J",
           "percent": "%"}  # fmt: skip


class Column(NamedTuple):
    """A row of columns.csv."""

    key: str
    unit: str
    files: str
    meaning: str


with (ROOT / "toros_fem" / "results" / "columns.csv").open(encoding="utf-8") as table:
    COLUMNS = [Column(*row) for row in csv.reader(table)][1:]


def column(key: str) -> Column | None:
    """The row of exactly this key, or of its last part, before patterns."""
    last, known = key.rpartition(".")[2], {row.key: row for row in COLUMNS}
    if key in known or last in known:
        return known.get(key, known.get(last))
    dotted = [row for row in COLUMNS if "." in row.key and fnmatchcase(key, row.key)]
    plain = [row for row in COLUMNS if "." not in row.key and fnmatchcase(last, row.key)]
    return next(iter(dotted + plain), None)


def written() -> dict[str, set[str]]:
    """Files by columns of tables and keys of JSON, of the runs in golden/file_heads.csv."""
    found = defaultdict(set)
    with (GOLDEN / "file_heads.csv").open(encoding="utf-8") as file:
        for head, _ in csv.reader(file):
            name, separator, key = head.partition(": ")
            if separator and name.endswith((".csv", ".json")):
                for one in key.split(", "):
                    found[one].add(name.rpartition("/")[2])
    return dict(found)


def test_each_is_described_and_each_row_is_of_use() -> None:
    rows = {key: column(key) for key in written()}
    assert not [key for key, row in rows.items() if row is None]
    assert not set(COLUMNS) - set(rows.values())
    assert column("no such column") is None


def test_each_tells_the_files_that_have_it() -> None:
    files: dict[str, set[str]] = {row.key: set() for row in COLUMNS}
    for key, names in written().items():
        row = column(key)
        assert row is not None
        files[row.key] |= names
    assert {row.key: row.files for row in COLUMNS} == {
        key: " ".join(sorted(names)) for key, names in files.items()
    }


def test_units_are_those_of_the_names() -> None:
    for key in written():
        row, ending = column(key), next((e for e in ENDINGS if key.endswith(f"_{e}")), None)
        if row is not None and ending is not None and "*" not in row.key:
            assert row.unit == ENDINGS[ending], (key, row)
