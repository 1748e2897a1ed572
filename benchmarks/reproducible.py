"""Spread of runs that differ by rounding or by their seed alone.

    python benchmarks/reproducible.py --seeds 8 --kernels Haswell SkylakeX
    python benchmarks/reproducible.py --scenes contract --seeds 3 --ranks 2
    python benchmarks/reproducible.py --docs

Designs the coarse demos with each seed and each kernel type of OpenBLAS, one run after the other,
each in a process of its own with one thread. A row is added to `reproducible.csv` after each run;
runs that have a row already are left out. The table shows how far rounds, figure and time spread;
`--docs` runs nothing and writes it into docs/optimisation.md.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent))

from demo_runs import DEMOS, value_of, without_curve
from page_tables import replaced

from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor
from toros_fem.mechanics.equilibrium.newton import NewtonResult, RegularisedNewton

FILE = Path(__file__).parent / "reproducible.csv"
PAGE = Path(__file__).parent.parent / "docs" / "optimisation.md"
MARKS = ("<!-- reproducible runs -->", "<!-- end of the reproducible runs -->")
# The figure that a scene is known by.
FIGURES = {"bend": "angle_deg", "contract": "shortening_percent", "gripper": "held_mass_kg"}
KEY = ("scene", "seed", "kernel", "gmsh", "ranks")
COLUMNS = (*KEY, "rounds", "figure", "newton_steps", "factorisations", "cpu_seconds", "seconds")


def counted(counts: dict[str, int]) -> None:
    """Count Newton steps and factorisations of all solves from now on, failed ones included."""
    minimise, factorise = RegularisedNewton.minimise, TangentFactor.factorise

    def minimised(self: RegularisedNewton, *given: Any, **named: Any) -> NewtonResult:
        found = minimise(self, *given, **named)
        counts["newton_steps"] += sum(row.step > 0 and not row.modified for row in found.history)
        return found

    def factorised(self: TangentFactor, *given: Any, **named: Any) -> bool:
        counts["factorisations"] += 1
        return factorise(self, *given, **named)

    RegularisedNewton.minimise = minimised  # type: ignore[method-assign]
    TangentFactor.factorise = factorised  # type: ignore[method-assign]


def run(scene: str, seed: int, folder: Path) -> dict[str, Any]:
    """Design a demo and return rounds, figure and costs (collective)."""
    counts = {"newton_steps": 0, "factorisations": 0}
    counted(counts)
    demo = DEMOS[scene]
    config = without_curve(demo.coarse(demo.config)).updated(seed=seed)
    summary = demo.run(MPI.COMM_WORLD, folder, config)
    figure = value_of(summary, FIGURES[scene])
    return {"rounds": summary["rounds"], "figure": figure, **counts}


def started(scene: str, seed: int, kernel: str, ranks: int) -> dict[str, Any]:
    """Run a demo in a process of its own and return its row; one that failed has no figures."""
    environment = {**os.environ, "OPENBLAS_CORETYPE": kernel, "OMP_NUM_THREADS": "1"}
    parallel = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    with tempfile.TemporaryDirectory() as folder:
        own = [sys.executable, __file__, "--one", scene, str(seed), folder]
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([*parallel, *own], env=environment, capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found = Path(folder) / "found.json"
        figures = json.loads(found.read_text(encoding="utf-8")) if found.is_file() else {}
    if done.returncode:
        print(done.stdout[-2000:], done.stderr[-2000:], file=sys.stderr)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    spent = {"cpu_seconds": round(cpu, 1), "seconds": round(time.perf_counter() - begin, 1)}
    key = dict(zip(KEY, (scene, seed, kernel, gmsh.__version__, ranks), strict=True))
    return {**key, **figures, **spent}


def table(rows: list[dict[str, str]]) -> str:
    """Return the spread of each scene's runs as Markdown."""
    first = rows[0]
    kernels = sorted({row["kernel"] for row in rows})
    lines = [
        f"OpenBLAS with the kernel types {' and '.join(kernels)}, gmsh {first['gmsh']}, ranks: "
        f"{first['ranks']}, one thread each.",
        "",
        "| scene | seeds, runs, failed | rounds | least, median, largest figure | kernels differ "
        "by at most | CPU s: median, longest over it |",
        "|---|---|---|---|---|---|",
    ]
    for scene, key in FIGURES.items():
        runs = [row for row in rows if row["scene"] == scene]
        good = [row for row in runs if row["figure"]]
        if not good:
            continue
        figure, rounds, spent = (
            np.array([float(row[name]) for row in good])
            for name in ("figure", "rounds", "cpu_seconds")
        )
        seeds = np.array([int(row["seed"]) for row in good])
        apart = max(np.ptp(figure[seeds == seed]) for seed in seeds) / np.median(figure)
        low, middle, high = figure.min(), np.median(figure), figure.max()
        lines.append(
            f"| {scene} | {len(np.unique(seeds))}, {len(runs)}, {len(runs) - len(good)} | "
            f"{rounds.min():.0f} to {rounds.max():.0f} | {low:.4g}, {middle:.4g}, {high:.4g} "
            f"(`{key}`) | {apart:.1g} of it | {np.median(spent):.0f}, "
            f"{spent.max() / np.median(spent):.2f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Run what the command line gives and the file has not."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", choices=list(FIGURES), default=list(FIGURES))
    parser.add_argument("--seeds", type=int, default=8, help="number of seeds, starting at 1")
    parser.add_argument("--kernels", nargs="+", default=["Haswell", "SkylakeX"])
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--csv", type=Path, default=FILE, help="file of the rows")
    parser.add_argument("--docs", action="store_true", help="only write the table into the page")
    parser.add_argument("--one", nargs=3, metavar=("SCENE", "SEED", "FOLDER"), help="one run here")
    given = parser.parse_args()
    if given.one:
        scene, seed, folder = given.one
        figures = run(scene, int(seed), Path(folder))
        if MPI.COMM_WORLD.rank == 0:
            (Path(folder) / "found.json").write_text(json.dumps(figures), encoding="utf-8")
        return
    rows: list[dict[str, str]] = []
    if given.csv.is_file():
        with given.csv.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    known = {tuple(row[name] for name in KEY) for row in rows}
    wanted = [
        (n, s + 1, k) for s in range(given.seeds) for n in given.scenes for k in given.kernels
    ]
    for scene, seed, kernel in [] if given.docs else wanted:
        if (scene, str(seed), kernel, gmsh.__version__, str(given.ranks)) in known:
            continue
        row = started(scene, seed, kernel, given.ranks)
        rows.append({name: str(row.get(name, "")) for name in COLUMNS})
        with given.csv.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)
    print(table(rows))
    if given.docs:
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(replaced(page, *MARKS, table(rows)), encoding="utf-8")


if __name__ == "__main__":
    main()
