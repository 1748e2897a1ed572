"""Patterns from random starts: relaxed design, lines laid along it, and print of each tube.

    scripts/fenicsx python3 benchmarks/discovery.py --json benchmarks/discovery.json
    scripts/fenicsx python3 benchmarks/discovery.py --coarse --scenes bend contract --seeds 0 1
    scripts/fenicsx python3 benchmarks/discovery.py --from benchmarks/discovery.json --docs

Runs the tube demos from several seeds, each in processes of its own, and lists the figures of all
stages: those of the relaxed design, those of its lines before any step on densities, and those of
the final print. Nothing hints at a direction. Seconds are wall time of the whole run, files and
pictures left out: the machine should do nothing else. Half an hour and more for each scene.

The JSON file is written after each run. Runs that are in it already are not repeated; delete the
file after a change of the code. `--docs` writes the tables into docs/discovery.md.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from page_tables import replaced

FOLDER = Path(__file__).parent
PAGE = FOLDER.parent / "docs" / "discovery.md"
# The tables stand between these lines of the page.
BEGIN, END = "<!-- tables of benchmarks/discovery.py -->", "<!-- end of the tables -->"
SEEDS = (0, 1, 2, 3, 4)
STAGES = ("relaxed", "lines", "printed")
# What densities start from: noise, or the lines of a relaxed design.
STARTS = ("random", "relaxed")
# Coarse runs should reach this fraction of what is asked.
COARSE = 0.85

Row = dict[str, Any]


@dataclass(frozen=True)
class Scene:
    """A tube to design.

    Attributes:
        demo: Name of the demo.
        title: What is asked.
        asked: Figures of which coarse runs should reach most, by their keys.
        reach: Least and largest value of each figure that counts as reached, by its key.
        changes: What differs from the demo's defaults.
    """

    demo: str
    title: str
    asked: Mapping[str, float]
    reach: Mapping[str, tuple[float, float]]
    changes: Mapping[str, Any] = field(default_factory=dict)


SCENES = {
    "bend": Scene("bend", "bend by 180° at 5 kPa", {"angle_deg": 180}, {"angle_deg": (178, 182)}),
    "contract": Scene(
        "contract",
        "shorten by 8 % at 10 kPa",
        {"shortening_percent": 8},
        {"shortening_percent": (7.7, 8.3), "twist_deg": (-3, 3)},
    ),
    "twist": Scene(
        "twist",
        "twist by 300° at 15 kPa, length free",
        {"twist_deg": 300},
        {"twist_deg": (294, 306)},
    ),
    "twist_length": Scene(
        "twist",
        "twist by 300° at 15 kPa, length kept",
        {"twist_deg": 250},
        {"twist_deg": (250, 306), "length_ratio": (0.97, 1.03)},
        {"keep_length": True},
    ),
    "bend_twist": Scene(
        "bend_twist",
        "bend by 90° and twist by 60° at 10 kPa",
        {"angle_deg": 90, "twist_deg": 60},
        {"angle_deg": (87, 93), "twist_deg": (57, 63)},
    ),
}
# A run of a few steps.
QUICK_SEEDS = (0,)
QUICK_CHANGES = {
    "edge_length": 5.5e-3,
    "filter_radius": 8.5e-3,
    "iterations": 2,
    "constrained_iterations": 1,
    "polish_iterations": 0,
    "relaxed_edge_length": 6e-3,
    "relaxed_iterations": 2,
    "laid_width": 3e-3,
    "second_laid_width": 3e-3,
    "print_edge_length": 3e-3,
    "corrections": 0,
}


@dataclass(frozen=True)
class Task:
    """One run.

    Attributes:
        scene: Name of the scene.
        seed: Seed of the random start.
        size: "full", "coarse" or "quick".
        start: What the densities start from; None takes the demo's default.
        ranks, threads: Ranks, and threads of each.
    """

    scene: str
    seed: int
    size: str
    start: str | None
    ranks: int
    threads: int

    def is_that_of(self, row: Row) -> bool:
        """Return whether a row is the result of this run."""
        return "failure" not in row and row["task"] == self.__dict__


def design(task: Task) -> Row:
    """Run one design on the ranks that this runs on; return its row."""
    from demo_runs import DEMOS, without_curve
    from mpi4py import MPI

    comm, scene = MPI.COMM_WORLD, SCENES[task.scene]
    demo = DEMOS[scene.demo]
    config: Any = demo.config if task.size == "full" else demo.coarse(demo.config)
    config = config.updated(seed=task.seed, **scene.changes)
    if task.size == "quick":
        config = config.updated(**QUICK_CHANGES)
    if task.start is not None:
        config = config.updated(start=task.start)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(comm.bcast(name, root=0))
        summary = demo.run(comm, folder, without_curve(config))
        comm.barrier()  # the first rank writes into its folder until here
    return {"task": dict(task.__dict__), **figures(summary)}


def figures(summary: Mapping[str, Any]) -> Row:
    """Return the figures of a run, from its summary."""
    keys = [key for key in summary["design"] if key in summary and key != "volume_m3"]
    relaxed, lines, made = summary.get("relaxed"), summary.get("lines"), summary["manufacture"]
    return {
        "start": summary["inputs"]["start"],
        "relaxed": relaxed and {key: relaxed.get(key) for key in keys},
        "relaxed_steps": relaxed and relaxed["steps"],
        "relaxed_seconds": relaxed and relaxed["seconds"],
        "lines": lines and {key: lines.get(key) for key in keys},
        "line_widths_mm": lines and [family["width_mm"] for family in lines["families"]],
        "rounds": lines and len(lines["rounds"]),
        "printed": {key: summary[key] for key in keys},
        "pressure_pa": summary["pressure_pa"],
        "density_steps": summary["iterations"],
        "islands": made["islands"],
        "width_mm": made["smallest_width_mm"],
        "gap_mm": made["smallest_gap_mm"],
        "triangles": summary["triangles"] * summary["parts_by_symmetry"],
        "seconds": summary["seconds"]["total"],
        "versions": summary["versions"],
    }


def run(task: Task, *, verbose: bool) -> Row:
    """Run one design in processes of its own; return its row, or one with its failure."""
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "row.json"
        given = json.dumps(task.__dict__)
        command = [sys.executable, __file__, "--worker", given, "--json", str(file)]
        if task.ranks > 1:
            command = ["mpirun", "-n", str(task.ranks), *command]
        environment = {**os.environ, "OMP_NUM_THREADS": str(task.threads)}
        done = subprocess.run(
            command,
            env=environment,
            stdout=None if verbose else subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
            return {"task": dict(task.__dict__), "failure": lines[-1]}
        row: Row = json.loads(file.read_text(encoding="utf-8"))
    return row


def read(file: Path | None) -> list[Row]:
    """Return the rows of a file; none if there is no file."""
    if file is None or not file.exists():
        return []
    rows: list[Row] = json.loads(file.read_text(encoding="utf-8"))["rows"]
    return rows


def complete(
    tasks: Sequence[Task], rows: Sequence[Row], make: Callable[[Task], Row], file: Path | None
) -> list[Row]:
    """Return the rows of all tasks, and make those that are missing; others are kept behind them.

    Args:
        tasks: What to run.
        rows: Rows that are known.
        make: Runs a task.
        file: File that is written after each run; None for none.
    """
    found: list[Row] = []
    rest = [row for row in rows if not any(row["task"] == task.__dict__ for task in tasks)]
    for number, task in enumerate(tasks):
        known = [row for row in rows if task.is_that_of(row)]
        found.append(known[0] if known else make(task))
        if known:
            continue
        print(line(found[-1]), flush=True)
        if file is not None:
            later = [row for row in rows for other in tasks[number + 1 :] if other.is_that_of(row)]
            text = json.dumps({"rows": [*found, *later, *rest]}, indent=1)
            file.write_text(text + "\n", encoding="utf-8")
    return found + rest


def line(row: Row) -> str:
    """Return a row as a line of text."""
    task = row["task"]
    name = f"{task['scene']}, seed {task['seed']}, {task['size']}"
    if "failure" in row:
        return f"{name}: FAILED: {row['failure']}"
    stages = [f"{stage} {_values(row[stage])}" for stage in STAGES if row[stage] is not None]
    return f"{name}: {'; '.join(stages)}; {row['seconds']:.0f} s"


def _values(metrics: Mapping[str, float | None]) -> str:
    return ", ".join(f"{key} {_number(value, key)}" for key, value in metrics.items())


def _number(value: float | None, key: str) -> str:
    if value is None:
        return "–"
    return f"{value:.3f}" if key.endswith("ratio") else f"{value:.1f}"


def reached(row: Row) -> bool:
    """Return whether a print has what is asked of its scene, on coarse meshes most of it."""
    scene = SCENES[row["task"]["scene"]]
    bounds: Mapping[str, tuple[float, float]] = scene.reach
    if row["task"]["size"] != "full":
        bounds = {key: (COARSE * value, math.inf) for key, value in scene.asked.items()}
    values = {key: row["printed"][key] for key in bounds}
    return all(
        value is not None and bounds[key][0] <= value <= bounds[key][1]
        for key, value in values.items()
    )


def tables(rows: Sequence[Row]) -> str:
    """Return a Markdown table for each scene, size and start, one line for each seed."""
    parts = []
    for size in ("full", "coarse", "quick"):
        for (name, scene), start in itertools.product(SCENES.items(), (None, *STARTS)):
            kind = {"scene": name, "size": size, "start": start}
            own = [row for row in rows if kind.items() <= row["task"].items()]
            if own:
                notes = [*([] if size == "full" else [size]), *([start] if start else [])]
                note = f" ({', '.join(notes)})" if notes else ""
                parts.append(f"**{scene.title}**{note}\n\n{_table(scene, own)}")
    return "\n\n".join(parts)


def _table(scene: Scene, rows: Sequence[Row]) -> str:
    keys = list(scene.reach)
    if scene.demo == "twist" and "length_ratio" not in keys:
        keys.append("length_ratio")
    names = [key.rsplit("_", 1) for key in keys]
    units = {"deg": "°", "percent": " %", "ratio": "×"}
    heads = [f"{stage}: {', '.join(name for name, _ in names)}" for stage in STAGES]
    titles = ["seed", *heads, "line, gap in mm", "steps", "time", "reached"]
    lines = ["| " + " | ".join(titles) + " |", "|---" * len(titles) + "|"]
    for row in rows:
        seed = str(row["task"]["seed"])
        if "failure" in row:
            lines.append(f"| {seed} | " + " | ".join("–" for _ in titles[2:]) + " | fails |")
            continue
        cells = [seed]
        for stage in STAGES:
            of = row[stage] or {}
            values = [
                _number(of.get(key), key) + (units[unit] if of.get(key) is not None else "")
                for key, (_, unit) in zip(keys, names, strict=True)
            ]
            cells.append(", ".join(values) if of else "–")
        widths = [row["width_mm"], row["gap_mm"]]
        cells.append(", ".join("–" if w is None else f"{w:.2f}" for w in widths))
        steps = row["relaxed_steps"]
        cells.append(f"{row['density_steps']}" if steps is None else
                     f"{steps} + {row['density_steps']}")  # fmt: skip
        cells += [f"{row['seconds']:.0f} s", "yes" if reached(row) else "no"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def with_tables(page: str, text: str) -> str:
    """Return a page with other tables between its two marks.

    Raises:
        ValueError: The page has no such marks.
    """
    return replaced(page, BEGIN, END, text)


def main() -> int:
    """Command line; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--seeds", nargs="+", type=int, default=list(SEEDS))
    parser.add_argument("--coarse", action="store_true", help="the demos' coarse variants")
    parser.add_argument("--quick", action="store_true", help="one tube and few steps")
    parser.add_argument(
        "--start", choices=STARTS, help="what densities start from; default: the demo's own"
    )
    parser.add_argument("--ranks", type=int, default=1, help="ranks of each run")
    parser.add_argument("--threads", type=int, default=2, help="threads of each rank")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--verbose", action="store_true", help="print every step of the designs")
    parser.add_argument("--from", type=Path, dest="source", help="run nothing, read these rows")
    parser.add_argument("--docs", action="store_true", help="write the tables into the page")
    parser.add_argument("--page", type=Path, default=PAGE, help="the page")
    parser.add_argument("--worker", type=json.loads, help=argparse.SUPPRESS)
    o = parser.parse_args()
    if o.worker:
        return work(Task(**o.worker), o.json)
    if o.source:
        rows = read(o.source)
    else:
        size = "quick" if o.quick else "coarse" if o.coarse else "full"
        scenes, seeds = (["contract"], QUICK_SEEDS) if o.quick else (o.scenes, o.seeds)
        tasks = [
            Task(scene, seed, size, o.start, o.ranks, o.threads)
            for scene in scenes
            for seed in seeds
        ]
        rows = complete(tasks, read(o.json), lambda task: run(task, verbose=o.verbose), o.json)
    text = tables(rows)
    print(f"\n{text}")
    if o.docs:
        page = o.page.read_text(encoding="utf-8")
        o.page.write_text(with_tables(page, text), encoding="utf-8")
    return int(any("failure" in row for row in rows))


def work(task: Task, file: Path) -> int:
    """Run one design and write its row on the first rank; return the exit code."""
    from mpi4py import MPI

    from toros_fem.base.errors import TorosError

    try:
        row = design(task)
    except TorosError as error:  # raised by all ranks or by none
        if MPI.COMM_WORLD.rank == 0:
            print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
        return 2
    if MPI.COMM_WORLD.rank == 0:
        file.write_text(json.dumps(row), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
