"""The harness: rows, resuming, pages, and what each command's quick cases give."""

import math
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.scenes import ROOT

from benchmarks import bench, figures, intervals
from benchmarks.bench import Row
from benchmarks.speed.command import ratio_interval
from benchmarks.stability import command as stability

# Under mpirun a child process would act as one of its ranks.
ROWS = [
    Row("a case", "of, two", "3", "width", 1 / 3, "mm", 2e-300, None, "CPU", "2026-11-24", 'a "b"'),
    Row("a case", "", "", "gap", None),
]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    own = {k: v for k, v in os.environ.items() if not k.startswith(bench.RANK_VARIABLES)}
    command = [sys.executable, "-m", "benchmarks", *arguments]
    return subprocess.run(command, env=own, cwd=ROOT, capture_output=True, text=True)


def found(file: Path, *arguments: str) -> list[Row]:
    """Return the rows of a command, all of them finite and stamped."""
    assert bench.main([*arguments, "--rows", str(file)]) == 0
    rows = bench.read(file)
    assert rows
    for row in rows:
        assert row.value is None or math.isfinite(row.value), row
        assert row.machine
        assert row.measured[:2] == "20"
    return rows


def value(rows: Sequence[Row], figure: str, variant: str | None = None) -> float:
    (one,) = (r.value for r in rows if r.figure == figure and variant in (None, r.variant))
    return one


def test_rows_come_back(tmp_path: Path) -> None:
    file = tmp_path / "rows.csv"
    bench.write(file, ROWS[:1])
    with file.open("a", encoding="utf-8") as lines:
        lines.write("a case,,,ga")  # killed while it wrote
    assert bench.read(file) == ROWS[:1]
    bench.write(file, ROWS[1:], append=True)
    assert bench.read(file) == ROWS


@pytest.mark.parametrize("workers", [1, 2])
def test_what_is_finished_is_not_repeated(tmp_path: Path, workers: int) -> None:
    file, keys = tmp_path / "rows.csv", ["uniaxial-width: membrane right", "tile-stripes"]
    new: list[str] = []
    for _ in range(2):
        failed = bench.complete(
            "accuracy", True, keys, file, workers, lambda rows: new.append(rows[0].case)
        )
        assert failed == 0
    assert sorted(new) == ["tile-stripes", "uniaxial-width"]
    assert bench.complete("accuracy", True, [keys[0], "no case"], file, 1) == 1


def test_a_deadline_ends_a_hang() -> None:
    with pytest.raises(TimeoutError, match=r"gave up after 0\.05 s"), bench.deadline(0.05):
        time.sleep(60)


@pytest.mark.parametrize("name", list(bench.COMMANDS))
def test_pages_have_the_tables_of_the_committed_rows(name: str) -> None:
    command, path = bench.command_of(name), bench.ROWS / f"{name}.csv"
    assert path.exists() is bool(command.tables)
    rows = bench.read(path)
    for page, text in bench.pages(command, rows).items():
        assert page.read_text(encoding="utf-8") == text
    assert list(command.condense(rows)) == rows
    # A row of a case that is gone would stay for ever.
    known = {case.name for case in command.cases(False)}
    assert {row.case.removesuffix(bench.IN_ALL) for row in rows} <= known
    with pytest.raises(ValueError, match="the page needs the lines"):
        bench.with_table("a page", "mark", "table")


def test_ratio_of_times_and_frequencies_by_hand() -> None:
    """Logarithms ln 2 ± ln 2: their mean has the error ln 2, Student's t of one degree 12.706."""
    ratio, low, high = ratio_interval([4.0, 3.0], [1.0, 3.0])
    assert ratio == pytest.approx(2)
    assert [low, high] == pytest.approx([2 / 2**12.7062, 2 * 2**12.7062], rel=1e-4)
    assert ratio_interval([3.0], [2.0]) == (1.5, 0.0, math.inf)
    # All of n: the lower end is 0.025 to the power of 1/n.
    assert intervals.held_between(30, 30) == pytest.approx((0.025 ** (1 / 30), 1))
    assert intervals.held_between(0, 2) == pytest.approx((0, 1 - 0.025**0.5))


def test_hundreds_of_cells_are_counted() -> None:
    labels = [f"tube helix x300 {load} Pa cold" for load in (100, 1000, 5000)]
    ends = ("converged", "failed", "converged")
    rows = [
        Row("matrix", label, "", end, float(steps), "steps")
        for label, end, steps in zip(labels, ends, (10, 400, 20), strict=True)
    ]
    counted = stability.condense(rows)
    assert [row for row in counted if row.case == "matrix"][:1] == [rows[1]]
    whole = {row.figure: row.value for row in counted if row.variant == "all"}
    assert (whole["cases"], whole["converged"], whole["failed"], whole["wrong"]) == (3, 2, 1, 0)
    assert (whole["steps: median"], whole["most"]) == (20, 400)
    assert stability.bad(rows[1])
    assert not stability.bad(rows[0])


def test_figures_of_a_demo_are_shown_with_target_and_interval() -> None:
    row = Row("bend", "full", "", "angle_deg", 178.812, "deg", 180.0, note="± 1.5, not certain")
    rows = [row, replace(row, figure="design.angle_deg", value=181.0, reference=None, note="")]
    coarse = [replace(one, variant="coarse", seconds=70.0) for one in rows]
    assert figures.table(rows, "full").splitlines()[2:] == [
        "| `bend` | Fig. 8b: 180° (5 kPa) | angle 178.8 ± 1.5° of 180° | not certain | 181° "
        "| – | – |"
    ]
    assert figures.headline([*rows, *coarse]).splitlines() == [
        "| [![bend](demos/pictures/bend_hero.png)](docs/gallery/index.md#bend) |", "| --- |",
        "| `bend`: angle 178.8 ± 1.5° of 180° (not certain). 1.2 min |",
    ]  # fmt: skip


@pytest.mark.slow
def test_quick_cases_of_accuracy(tmp_path: Path) -> None:
    """The roof of Sze, Liu & Lo snaps at 0.743 of its load; stripes are exact on every mesh."""
    rows = found(tmp_path / "rows.csv", "accuracy", "--quick", "--only", "path-roof: 12.7")
    assert value(rows, "limit 1") == pytest.approx(0.743 * 3000, rel=0.02)
    rows = found(tmp_path / "tiles.csv", "accuracy", "--quick", "--only", "tile-stripes")
    assert (
        max(row.value or 0 for row in rows if row.figure == "worst error") < 1e-7
    )  # borders on a grid


@pytest.mark.slow
def test_quick_cases_of_stability(tmp_path: Path) -> None:
    """Each start of a scene converges; a drawn one too; nothing passes through anything."""
    file = tmp_path / "rows.csv"
    for only in ("matrix: half_tube", "random: seed 12", "contact: pressed tube"):
        rows = found(file, "stability", "--quick", "--only", only)
    assert sum(row.figure == "converged" for row in rows) == 4
    assert max(row.value or 0 for row in rows if row.figure == "residual") < 1e-8
    assert [r.figure for r in rows if r.case == "random"] == ["equilibrium", "pairs"]
    assert [value(rows, f"crosses {way}") for way in ("without", "with")] == [1, 0]


@pytest.mark.slow
def test_quick_cases_of_speed(tmp_path: Path) -> None:
    """A replay ends in an equilibrium; the same code takes the same steps again."""
    rows = found(tmp_path / "rows.csv", "speed", "--quick", "--only", "cold, membrane")
    assert value(rows, "residual") < 1e-8
    file = tmp_path / "against.csv"
    done = run("speed", "--quick", "--only", "cold, membrane", "--rounds", "2",
               "--against", str(ROOT), "--rows", str(file))  # fmt: skip
    assert done.returncode == 0, done.stderr
    for row in bench.read(file):
        if row.figure != "time ratio":
            assert row.value == row.reference == value(rows, row.figure)


@pytest.mark.slow
def test_quick_cases_of_scale(tmp_path: Path) -> None:
    """Each phase has its seconds; three unknowns a triangle, positions and a turn of each edge."""
    rows = found(tmp_path / "rows.csv", "scale", "--quick", "--only", "1000")
    assert value(rows, "unknowns") == pytest.approx(3 * int(rows[0].size), rel=0.05)
    spent = [row.value or 0 for row in rows if row.figure.endswith("_s")]
    assert len(spent) == 17
    assert min(spent) > 0
    assert 0 < value(rows, "setup_gib") <= value(rows, "step_gib") <= value(rows, "peak_gib") < 1


@pytest.mark.slow
def test_quick_cases_of_figures(tmp_path: Path) -> None:
    """The plain tube swells as published."""
    committed = {row.figure: row for row in bench.read(bench.ROWS / "figures.csv")
                 if (row.case, row.variant) == ("inflate", "coarse")}  # fmt: skip
    rows = found(tmp_path / "rows.csv", "figures", "--quick")
    assert len(rows) == len(committed)
    for row in rows:
        assert row.value == pytest.approx(committed[row.figure].value, rel=5e-3), row


@pytest.mark.slow
def test_quick_cases_of_intervals(tmp_path: Path) -> None:
    rows = found(tmp_path / "rows.csv", "intervals", "--quick", "--only", "seed 0")
    kinds = {row.case for row in rows}
    assert kinds <= set(intervals.KINDS)
    assert len(kinds) >= 4, "what hardly moves is not told"
    limits = {
        (row.case, row.size, row.figure.removesuffix(", limit")): row.value
        for row in rows
        if row.figure.endswith(", limit")
    }
    for row in rows:
        if row.figure.endswith(", half-width"):
            limit = limits[row.case, row.size, row.figure.removesuffix(", half-width")]
            assert 0 < row.value < 5 * limit
