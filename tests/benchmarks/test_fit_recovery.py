"""The table of recovered constants: what the page says, and that intervals hold the truth."""

import json
from typing import Any

import fit_recovery
import pytest
from helpers.scenes import ROOT

ROWS = json.loads((ROOT / "benchmarks" / "fit_recovery.json").read_text(encoding="utf-8"))
# What these cases break: one kind of interval takes noise as independent.
TOO_NARROW = {("noise correlated by 0.7", "hessian"), ("five strips, 5 % apart", "hessian")}


def line(row: dict[str, Any]) -> str:
    held = row["held"]
    names = ("young", "poisson", "mu", "lam", "c1", "c2")
    numbers = [held[name] for name in names] + [row["identified"][name] for name in ("c1", "c2")]
    cells = [row["case"], row["intervals"], *map(str, numbers)]
    return f"| {' | '.join(cells)} | {100 * row['width_of_young']:.0f} % |"


def test_page_has_the_table() -> None:
    page = (ROOT / "docs" / "characterisation.md").read_text(encoding="utf-8")
    assert [row for row in ROWS if line(row) not in page] == []
    found = {(row["case"], row["intervals"]) for row in ROWS}
    assert found == {
        (case, one) for case, (_, kinds) in fit_recovery.CASES.items() for one in kinds
    }


@pytest.mark.parametrize("case", ["one strip", "five strips, 5 % apart", "knit, both directions"])
def test_intervals_hold_the_truth(case: str) -> None:
    """In 90 of 100 draws at least, by the intervals that fit the noise."""
    kinds = [row for row in ROWS if row["case"] == case]
    used = [row for row in kinds if (case, row["intervals"]) not in TOO_NARROW]
    assert used
    for row in used:
        assert row["draws"] == 100
        assert min(row["held"].values()) >= 90, row


def test_a_row_is_made() -> None:
    row = fit_recovery.row("knit, both directions", "hessian", 2)
    assert set(row["held"]) == {"young", "poisson", "mu", "lam", "c1", "c2", "knit_ratio"}
    assert max(row["held"].values()) <= 2
