"""Every column and key that a run writes is described, with the unit that its name ends in."""

import csv

from kit.pin import GOLDEN

from toros_fem.results.columns import column, columns

ENDINGS = {"deg": "deg", "mm": "mm", "mm2": "mm²", "m3": "m³", "m2": "m²", "pa": "Pa", "n": "N",
           "per_m": "N/m", "kg": "kg", "j": "J", "percent": "%"}  # fmt: skip


def written() -> set[str]:
    """Columns of tables and keys of JSON, of the runs in golden/file_heads.csv."""
    found = set()
    with (GOLDEN / "file_heads.csv").open(encoding="utf-8") as file:
        for head, _ in csv.reader(file):
            name, separator, key = head.partition(": ")
            if separator and name.endswith((".csv", ".json")):
                found |= set(key.split(", "))
    return found


def test_each_is_described_and_each_row_is_of_use() -> None:
    rows = {key: column(key) for key in written()}
    assert not [key for key, row in rows.items() if row is None]
    assert not set(columns()) - set(rows.values())
    assert column("no such column") is None


def test_units_are_those_of_the_names() -> None:
    for key in written():
        row, ending = column(key), key.rpartition("_")[2]
        if row is not None and ending in ENDINGS and "*" not in row.key:
            assert row.unit in (ENDINGS.get(ending), ENDINGS.get("per_m"), "its own"), (key, row)
