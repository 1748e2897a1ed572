"""The benchmark of random starts: rows, resumption, tables."""

from pathlib import Path
from typing import Any

import discovery
import pytest
from discovery import Row, Task

SUMMARY: Row = {
    "inputs": {"start": "relaxed"},
    "shortening_percent": 7.94, "shortening_target_percent": 8.0, "twist_deg": -1.26,
    "length_ratio": 0.9206, "volume_m3": 1e-5, "pressure_pa": 1e4, "iterations": 12,
    "design": {"shortening_percent": 8.1, "twist_deg": -1.0, "length_ratio": 0.919, "shape": 1.0,
               "volume_m3": 1e-5},
    "relaxed": {"shortening_percent": 8.0, "twist_deg": 0.1, "length_ratio": 0.92,
                "seconds": 14.2, "steps": 61},
    "lines": {"shortening_percent": 7.4, "twist_deg": -2.0, "length_ratio": 0.926,
              "families": [{"width_mm": 0.9}, {"width_mm": 4.0}], "rounds": [{}, {}]},
    "manufacture": {"islands": 0, "smallest_width_mm": 0.71, "smallest_gap_mm": None},
    "triangles": 5000, "parts_by_symmetry": 2, "seconds": {"total": 101.4}, "versions": {},
}  # fmt: skip
TASK = Task("contract", 3, "full", None, 1, 2)


def row_of(task: Task = TASK, **changes: Any) -> Row:
    return {"task": dict(task.__dict__), **discovery.figures({**SUMMARY, **changes})}


def test_figures_of_all_stages() -> None:
    row = row_of()
    assert row["relaxed"] == {
        "shortening_percent": 8.0, "twist_deg": 0.1, "length_ratio": 0.92
    }  # fmt: skip
    assert row["lines"] == {
        "shortening_percent": 7.4, "twist_deg": -2.0, "length_ratio": 0.926
    }  # fmt: skip
    assert (row["line_widths_mm"], row["rounds"]) == ([0.9, 4.0], 2)
    assert row["printed"] == {
        "shortening_percent": 7.94, "twist_deg": -1.26, "length_ratio": 0.9206
    }  # fmt: skip
    assert (row["relaxed_steps"], row["density_steps"], row["triangles"]) == (61, 12, 10_000)
    plain = row_of(relaxed=None, lines=None)
    assert plain["relaxed"] is plain["lines"] is plain["relaxed_seconds"] is None


def test_what_counts_as_reached() -> None:
    assert discovery.reached(row_of())
    assert not discovery.reached(row_of(shortening_percent=8.31))
    assert not discovery.reached(row_of(twist_deg=3.1)), "it is not to twist"
    assert not discovery.reached(row_of(shortening_percent=None))
    coarse = Task("contract", 3, "coarse", None, 1, 2)
    assert discovery.reached(row_of(coarse, shortening_percent=6.81, twist_deg=9.0))
    assert not discovery.reached(row_of(coarse, shortening_percent=6.79))


def test_runs_that_are_known_are_not_repeated(tmp_path: Path) -> None:
    file, made = tmp_path / "rows.json", []
    tasks = [Task("contract", seed, "full", None, 1, 2) for seed in (0, 1, 2)]

    def make(task: Task) -> Row:
        made.append(task.seed)
        kept = [row["task"]["seed"] for row in discovery.read(file)]
        assert kept == {0: [], 1: [0, 9], 2: [0, 1, 9]}[task.seed], "it is written after each run"
        if task.seed == 1 and len(made) == 2:
            return {"task": dict(task.__dict__), "failure": "no equilibrium"}
        return row_of(task)

    # A row of another task stays.
    other = row_of(Task("bend", 9, "coarse", None, 1, 2), angle_deg=180.0)
    rows = discovery.complete(tasks, [other], make, file)
    assert made == [0, 1, 2]
    assert "failure" in rows[1]
    again = discovery.complete(tasks, discovery.read(file), lambda task: row_of(task), file)
    assert [row["task"]["seed"] for row in again] == [0, 1, 2, 9]
    assert "failure" not in again[1], "what failed is tried again"
    assert again[3] == other
    assert discovery.read(file) == again
    assert discovery.complete(tasks, again, make, None) == again
    assert made == [0, 1, 2]


def test_table_has_all_stages() -> None:
    failed = {"task": {**TASK.__dict__, "seed": 4}, "failure": "no equilibrium"}
    text = discovery.tables([row_of(), row_of(relaxed=None, lines=None), failed])
    title, _, head, rule, *lines = text.splitlines()
    assert title == "**shorten by 8 % at 10 kPa**"
    assert {line.count("|") for line in (head, rule, *lines)} == {9}
    assert lines[0] == (
        "| 3 | 8.0 %, 0.1° | 7.4 %, -2.0° | 7.9 %, -1.3° | 0.71, – | 61 + 12 | 101 s | yes |"
    )
    assert lines[1].startswith("| 3 | – | – | 7.9 %, -1.3° |")
    assert lines[2].endswith("| fails |")
    noise = Task("contract", 3, "coarse", "random", 1, 2)
    both = discovery.tables([row_of(), row_of(noise)])
    assert "\n\n**shorten by 8 % at 10 kPa** (coarse, random)\n\n" in both
    assert "101 s" in discovery.line(row_of())
    assert "FAILED: no equilibrium" in discovery.line(failed)


def test_tables_stand_between_their_marks() -> None:
    page = f"before\n{discovery.BEGIN}\nold\n{discovery.END}\nafter\n"
    once = discovery.with_tables(page, "| new |")
    assert "| new |" in once
    assert "old" not in once
    assert once.startswith("before\n")
    assert once.endswith("\nafter\n")
    assert discovery.with_tables(once, "| new |") == once
    with pytest.raises(ValueError, match="needs the lines"):
        discovery.with_tables("nothing", "")
