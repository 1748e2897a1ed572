"""Whole designs again, from several random starts and on several machines.

`tubes` designs the tubes from several seeds and lists the figures of all stages: those of the
relaxed design, those of its lines before any step on densities, and those of the final print.
Nothing hints at a direction. Seconds are wall time of the run, files and pictures left out.

`kernels` designs coarse demos with each seed and each kernel type of OpenBLAS, and shows how far
rounds, figure and time spread. Seconds are CPU seconds.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
from mpi4py import MPI

from benchmarks.bench import Case, Command, Row, Rows, Table, markdown, values_of
from toros_fem.products.kinds import KINDS

# Kind, title, least and largest value of each figure that counts as reached, what differs from the
# demo's defaults.
TUBES: dict[str, tuple[str, str, dict[str, tuple[float, float]], dict[str, Any]]] = {
    "bend": ("bend", "bend by 180° at 5 kPa", {"angle_deg": (178, 182)}, {}),
    "contract": (
        "contract", "shorten by 8 % at 10 kPa",
        {"shortening_percent": (7.7, 8.3), "twist_deg": (-3, 3)}, {},
    ),
    "twist": (
        "twist", "twist by 300° at 15 kPa, length free",
        {"twist_deg": (294, 306), "length_ratio": (0, np.inf)}, {},
    ),
    "twist, length kept": (
        "twist", "twist by 300° at 15 kPa, length kept",
        {"twist_deg": (250, 306), "length_ratio": (0.97, 1.03)}, {"keep_length": True},
    ),
    "bend and twist": (
        "bend-twist", "bend by 90° and twist by 60° at 10 kPa",
        {"angle_deg": (87, 93), "twist_deg": (57, 63)}, {},
    ),
}  # fmt: skip
UNITS = {"deg": "°", "percent": " %", "ratio": "×"}
# The figure that a scene is known by.
FIGURES = {"bend": "angle_deg", "contract": "shortening_percent", "gripper": "held_mass_kg"}
TYPES = ("Haswell", "SkylakeX")
# A run of a few steps.
QUICK = {
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


def summary_of(kind: str, changes: Mapping[str, Any], *, coarse: bool = False) -> dict[str, Any]:
    """Design a skin and return the entries of its summary, and its figures by their keys."""
    scene: Any = KINDS[kind]()
    scene = (scene.coarse() if coarse else scene).updated(**changes)
    if "curve_pressure" in scene.described():
        scene = scene.updated(curve_pressure=None)
    run = scene.run_design if hasattr(scene, "run_design") else scene.run_simulation
    with tempfile.TemporaryDirectory() as folder:
        found = run(MPI.COMM_SELF, Path(folder))
    told = {figure.key: figure.value for figure in found.figures}
    errors = {f"{one.name}_error_{one.unit}": one.interval for one in found.figures}
    return {**found.entries(), **told, **errors}


def tube_rows(scene: str, seed: int, quick: bool) -> Iterator[Row]:
    """Design a tube from a seed."""
    kind, _, reach, changes = TUBES[scene]
    place = ("tubes", f"{scene}, seed {seed}", "quick" if quick else "full")
    more = QUICK if quick else {}
    found = summary_of(kind, {**changes, **more, "seed": seed}, coarse=quick)
    made, relaxed = found["manufacture"], found.get("relaxed")
    stages = {"relaxed": relaxed, "lines": found.get("lines"), "printed": found}
    for stage, of in stages.items():
        for key in reach if of else ():
            yield Row(*place, f"{stage} {key}", of.get(key), key.rpartition("_")[2])
    yield Row(*place, "line", made["smallest_width_mm"], "mm")
    yield Row(*place, "gap", made["smallest_gap_mm"], "mm")
    if relaxed:
        yield Row(*place, "relaxed steps", float(relaxed["steps"]))
    seconds = found["seconds"]["total"]
    yield Row(*place, "density steps", float(found["iterations"]), seconds=seconds)


def kernel_rows(scene: str, seed: int, kernel: str, changes: Mapping[str, Any]) -> Iterator[Row]:
    """Design a coarse demo on one kernel type, which the environment sets."""
    place = ("kernels", f"{scene}, seed {seed}, {kernel}", "ranks 1")
    begin = time.process_time()
    found = summary_of(scene, {**changes, "seed": seed}, coarse=True)
    spent = time.process_time() - begin
    note = f"gmsh {gmsh.__version__}"
    figure = found[FIGURES[scene]]
    yield Row(*place, "rounds", float(found["rounds"]))
    yield Row(*place, FIGURES[scene], figure, seconds=round(spent, 1), note=note)


def cases(quick: bool) -> list[Case]:
    """Return all designs; a quick selection takes few steps, and few of them."""
    found = [
        Case("tubes", partial(tube_rows, scene, seed, quick), f"{scene}, seed {seed}",
             alone=True, environment={"OMP_NUM_THREADS": "2"})
        for scene in (["contract"] if quick else TUBES)
        for seed in (range(1) if quick else range(5))
    ]  # fmt: skip
    found += [
        Case("kernels", partial(kernel_rows, scene, seed, kernel, QUICK if quick else {}),
             f"{scene}, seed {seed}, {kernel}", alone=True,
             environment={"OPENBLAS_CORETYPE": kernel})
        for seed in (range(1, 2) if quick else range(1, 9))
        for scene in (["contract"] if quick else FIGURES)
        for kernel in TYPES
    ]  # fmt: skip
    return found


def tubes_table(rows: Rows) -> str:
    """Return a line for each tube: the prints of all its seeds."""
    seconds = {
        (row.variant, row.size): row.seconds or 0.0 for row in rows if row.figure == "density steps"
    }
    lines = []
    for scene, (_, title, reach, _) in TUBES.items():
        own = {
            key[1:]: of
            for key, of in values_of(rows, "tubes").items()
            if key[1].rpartition(", seed ")[0] == scene
        }
        if not own:
            continue
        shown, reached = [], np.ones(len(own), bool)
        for key, (least, largest) in reach.items():
            found = [of.get(f"printed {key}") for of in own.values()]
            values = np.array([np.nan if value is None else value for value in found])
            reached &= (least <= values) & (values <= largest)
            ends = [_shown(key, float(q)) for q in np.nanquantile(values, [0, 0.5, 1])]
            shown.append(f"{key.rpartition('_')[0].partition('_')[0]} {', '.join(ends)}")
        median = float(np.median([seconds[place] for place in own]))
        lines.append((title, f"{reached.sum()} of {len(own)}", "; ".join(shown), f"{median:.0f} s"))
    return markdown(("tube", "reached", "print: least, median, largest", "median time"), lines)


def _shown(key: str, value: float) -> str:
    digits = 3 if key.endswith("ratio") else 1
    return f"{value:.{digits}f}{UNITS[key.rpartition('_')[2]]}"


def kernels_table(rows: Rows) -> str:
    """Return the spread of each scene's runs."""
    own = [row for row in rows if row.case == "kernels"]
    head = ("scene", "seeds, runs", "rounds", "least, median, largest figure",
            "kernels differ by at most", "CPU s: median, longest over it")  # fmt: skip
    lines = []
    for scene, key in FIGURES.items():
        runs = [row for row in own if row.figure == key and row.variant.startswith(f"{scene},")]
        if not runs:
            continue
        variants = {row.variant for row in runs}
        rounds = [r.value or 0 for r in own if r.figure == "rounds" and r.variant in variants]
        figure = np.array([row.value or np.nan for row in runs])
        spent = np.array([row.seconds or np.nan for row in runs])
        seeds = np.array([row.variant.split(", ")[1] for row in runs])
        apart = max(np.ptp(figure[seeds == seed]) for seed in seeds) / np.median(figure)
        three = (figure.min(), np.median(figure), figure.max())
        lines.append((
            scene, f"{len(set(seeds))}, {len(runs)}", f"{min(rounds):.0f} to {max(rounds):.0f}",
            f"{', '.join(f'{value:.4g}' for value in three)} (`{key}`)", f"{apart:.1g} of it",
            f"{np.median(spent):.0f}, {spent.max() / np.median(spent):.2f}",
        ))  # fmt: skip
    kernels = sorted({row.variant.rpartition(" ")[2] for row in own})
    about = f"OpenBLAS with the kernel types {' and '.join(kernels)}, "
    about += f"{next(row.note for row in own if row.note)}, {own[0].size}, one thread each."
    return f"{about}\n\n{markdown(head, lines)}"


COMMAND = Command(
    about=__doc__,
    cases=cases,
    serial=True,
    tables=(
        Table("discovery.md", "tubes from random starts", tubes_table),
        Table("optimisation.md", "reproducible runs", kernels_table),
    ),
)
