"""How long each file of tests takes, on one rank and on several: tests/durations.csv."""

from __future__ import annotations

import collections
import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

TABLE = Path(__file__).parents[1] / "durations.csv"
UNKNOWN = 5.0  # s, for a file that is in no table


def known() -> dict[str, tuple[float, float]]:
    """Seconds of each file, on one rank and on two."""
    if not TABLE.exists():
        return {}
    with TABLE.open(encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    return {name: (float(one), float(two)) for name, one, two in rows}


def order_by_durations(items: list[pytest.Item], ranks: int) -> None:
    """Sort tests such that the longest files come first, so that workers end together."""
    table = known()

    def key(item: pytest.Item) -> tuple[float, str]:
        name = item.nodeid.split("::")[0]
        return -table.get(name, (UNKNOWN, UNKNOWN))[ranks > 1], name

    items.sort(key=key)


def write_durations(reports: Iterable[Any], ranks: int) -> None:
    """Write the seconds of a whole run, its fixtures included, into the column of its leg."""
    spent: collections.Counter[str] = collections.Counter()
    for report in reports:
        if hasattr(report, "duration"):
            spent[report.nodeid.split("::")[0]] += report.duration
    table = known()
    names = set(spent) | {name for name in table if (TABLE.parents[1] / name).exists()}
    rows = []
    for name in sorted(names):
        both = list(table.get(name, (0.0, 0.0)))
        both[ranks > 1] = spent.get(name, 0.0)
        rows.append(f"{name},{both[0]:.1f},{both[1]:.1f}\n")
    TABLE.write_text("file,one_rank,two_ranks\n" + "".join(rows), encoding="utf-8")
