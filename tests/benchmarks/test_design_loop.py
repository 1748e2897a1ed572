"""docs/performance.md: its tables are those of the committed rows."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import design_loop
import design_loop_report as report
import pytest
from demo_runs import DEMOS
from helpers.scenes import ROOT

ROWS = json.loads((design_loop.FOLDER / "design_loop.json").read_text(encoding="utf-8"))["rows"]
SIZES = json.loads((design_loop.FOLDER / "scale.json").read_text(encoding="utf-8"))
PAGE = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")


def cells(line: str) -> list[str]:
    """Return the cells of a line of a Markdown table."""
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_page_is_that_of_the_rows() -> None:
    assert report.text(ROWS, SIZES) == PAGE
    assert "<!--" not in PAGE
    assert (ROOT / "docs" / "performance.png").stat().st_size > 10_000


def test_every_design_is_in_both_tables() -> None:
    """Read back from the page, independent of how it is written."""
    _, designs, cost = PAGE.split("\n| design | ")[:3]
    for part, keys in (
        (designs, {"levels": 4, "islands": 11}),
        (
            cost,
            {
                "steps": 3,
                "rejected": 4,
                "newton_steps": 5,
                "factorisations": 6,
                "finest_steps": 7,
                "finest_factorisations": 8,
            },
        ),
    ):
        lines = [line for line in part.splitlines() if line.startswith("| ") and "mm |" in line]
        assert len(lines) == len(ROWS)
        for line, row in zip(lines, ROWS, strict=True):
            assert {key: int(cells(line)[column]) for key, column in keys.items()} == {
                key: row[key] for key in keys
            }
            assert f"R = {row['radius_mm']:.3g} mm" in cells(line)[0]
    for line, row in zip(cost.splitlines()[2:], ROWS, strict=False):
        assert float(cells(line)[9]) == row["median_factorisations"]
        assert float(cells(line)[10]) == pytest.approx(row["mean_factorisations"], abs=0.051)


def test_ways_stand_beside_each_other() -> None:
    """Both ways on the same cores follow one another; every published case has several meshes."""
    assert {case.scene for case in design_loop.CASES.values()} <= set(DEMOS)
    assert set(design_loop.SCENES) <= set(DEMOS)
    assert design_loop.CASES["bend"].designs == [
        ("levels", (1, 1)), ("before", (1, 1)), ("levels", (1, 2)), ("levels", (2, 1)),
        ("before", (2, 1)),
    ]  # fmt: skip
    for case in (*design_loop.CASES.values(), *design_loop.QUICK.values()):
        config: Any = DEMOS[case.scene].config.updated(**case.changes)
        assert config.level_count > 1 or not case.before, "both ways would be one"


def test_cost_of_a_step_is_that_of_the_finest_mesh() -> None:
    """The start of a stage repeats the number of the last step, and belongs to no step."""
    history = [
        SimpleNamespace(
            level=level, iteration=iteration, factorisations=cost, newton_steps=2 * cost,
            rejected=1, seconds=0.5 * cost,
        )
        for level, iteration, cost in (
            (0, 0, 90), (0, 1, 70), (1, 1, 20), (1, 2, 3), (1, 3, 7), (1, 3, 10), (1, 4, 2),
        )
    ]  # fmt: skip
    found = design_loop.finest(history)
    assert (found["finest_steps"], found["finest_factorisations"]) == (3, 42)
    assert (found["median_factorisations"], found["mean_factorisations"]) == (3.0, 4.0)
    assert found["median_newton_steps"] == 6.0
    assert found["median_step_seconds"] == 1.5
    assert found["seconds_per_factorisation"] == 0.5
    assert found["seconds_per_newton_step"] == 0.25


def test_rows_of_other_cases_stay(tmp_path: Path) -> None:
    file = tmp_path / "rows.json"
    row = {"way": "levels", "seconds": 1.0}
    design_loop.write(file, [{"case": "twist", **row}])
    design_loop.write(file, [{"case": "bend", **row}])
    design_loop.write(file, [{"case": "bend", **row, "seconds": 2.0}])
    found = json.loads(file.read_text(encoding="utf-8"))["rows"]
    assert [(row["case"], row["seconds"]) for row in found] == [("bend", 2.0), ("twist", 1.0)]


def test_ratios_are_those_of_the_same_cores() -> None:
    one = {"case": "bend", "ranks": 1, "threads": 1}
    rows = [
        {**one, "way": "levels"},
        {**one, "way": "before", "ranks": 2},
        {**one, "way": "before"},
    ]
    assert report.beside(rows, rows[0]) is rows[2]
    assert report.beside(rows, rows[2]) is None
