"""Four prints of the demos on finer and finer meshes, until their figures stand.

The prints are files in `benchmarks/prints`, made once by the coarse scenes of the demos. Each is
simulated on the mesh of such a run, and on finer ones, whose fabric and borders are finer alike.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

from benchmarks.bench import Case, Command, Row, Rows, Table, markdown
from toros_fem.design.loop.miss import shape_of
from toros_fem.making.printability import read_print_polygons
from toros_fem.measures.figures import formatted, split_key
from toros_fem.products.actuators.estimates import Job, SimulatedPrint, simulated_on
from toros_fem.products.kinds import KINDS

FOLDER = Path(__file__).parent / "prints"
# Pressure in Pa of each print, by its kind of scene.
PRESSURES = {"bend": 6936.0, "contract": 2768.0, "twist": 15000.0, "bend-twist": 8297.0}
# Figures that tell a print, where it has them.
FIGURES = ("angle_deg", "twist_deg", "shortening_percent", "shape_distance_percent")
# Edges of the meshes over those of the coarse run's own.
RATIOS = (1.0, 0.7, 0.5, 0.35, 0.25)
QUICK = (2.25, 1.5)


def rows_of(kind: str, ratios: tuple[float, ...]) -> Iterator[Row]:
    """Simulate a print on all meshes, each from the shape on the one before."""
    comm = MPI.COMM_SELF
    scene: Any = KINDS[kind]().coarse()
    lines = scene.design.start == "relaxed"
    level = scene.print_level if lines else scene.finest_level
    stored = read_print_polygons(comm, FOLDER / f"{kind.replace('-', '_')}.npz")
    at_rest = scene.case(comm, level).pattern
    near = at_rest, at_rest.points
    for ratio in ratios:
        again = SimulatedPrint(near, (stored.pattern, stored.regions), [PRESSURES[kind]])
        begin = time.perf_counter()
        made = simulated_on(Job(comm, scene), level.scaled(ratio), again, ratio)
        seconds = time.perf_counter() - begin
        problem, at = made.problem, made.equilibrium
        near = problem.skin.pattern, problem.skin.gather_vertices(at.positions)
        place = (kind, "", f"{1e3 * level.scaled(ratio).edge_length:.2f} mm")
        values = {metric.key: metric.value(*near) for metric in problem.metrics} | shape_of(made)
        goals = {metric.key: metric.target for metric in problem.metrics}
        yield Row(*place, "unknowns", float(len(at.state)), seconds=round(seconds, 1))
        for key in FIGURES:
            if key in values and goals.get(key, 0.0) is not None:
                unit = (split_key(key) or ("", ""))[1]
                yield Row(*place, key, values[key], unit, goals.get(key))
        del made, problem, at


def cases(quick: bool) -> list[Case]:
    """Return a case for each print; a quick selection takes coarser meshes."""
    ratios = QUICK if quick else RATIOS
    return [Case(kind, partial(rows_of, kind, ratios), alone=True) for kind in PRESSURES]


def table(rows: Rows) -> str:
    """Return a line for each figure of each print: its values from coarse to fine."""
    lines = []
    for kind in PRESSURES:
        own = [row for row in rows if row.case == kind]
        sizes = list(dict.fromkeys(row.size for row in own))
        for key in FIGURES:
            found = {row.size: row for row in own if row.figure == key}
            if not found:
                continue
            told = [formatted(found[size].value, found[size].unit, 4) for size in sizes]
            lines.append((f"`{kind}`", key.rpartition("_")[0].replace("_", " "), ", ".join(told)))
        counts = [f"{row.value or 0:,.0f}" for row in own if row.figure == "unknowns"]
        edges = ", ".join(size.removesuffix(" mm") for size in sizes)
        if counts:
            lines.append(("", f"unknowns, at edges of {edges} mm", ", ".join(counts)))
    return markdown(("print", "figure", "the coarse run's mesh, and finer ones"), lines)


COMMAND = Command(
    about=__doc__,
    cases=cases,
    serial=True,
    tables=(Table("accuracy.md", "four prints", table),),
)
