"""Told intervals against meshes that are four times finer.

A simulation ends with an estimate of its discretisation error, from one refinement of its mesh.
Here designs are drawn by a seed: stiff lines of several slopes and widths on the tube, at several
pressures. Each is simulated on a coarse mesh, and again with each triangle divided into sixteen;
the density of a triangle is that of all its parts. The estimate should hold the change.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.stats import beta

from benchmarks.bench import Case, Command, Row, Rows, Table, markdown, timed
from toros_fem.materials.sheet import Composite
from toros_fem.measures.metrics import MetricFunction, bend_angle, length_ratio, twist_angle
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.error_estimate import estimate_error
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Pattern, cylinder, sew
from toros_fem.meshes.transfer import refine

Floats = npt.NDArray[np.float64]
LENGTH, DIAMETER = 0.1, 0.02  # m
EDGE, QUICK_EDGE = 2.85e-3, 5.5e-3  # m; that of the coarse demos, and twice as long
SEEDS = range(30)
# What is measured, with its unit and the factor to it.
METRICS: dict[str, tuple[MetricFunction, str, float]] = {
    "angle": (bend_angle, "deg", 180 / np.pi),
    "twist": (twist_angle, "deg", 180 / np.pi),
    "length": (length_ratio, "", 1.0),
}


def drawn(seed: int, pattern: Pattern) -> tuple[Floats, float]:
    """Return densities of lines on the tube, and a pressure in Pa."""
    rng = np.random.default_rng([31, seed])
    lines, turns = int(rng.integers(1, 4)), float(rng.uniform(-1.5, 1.5))
    width, pressure = float(rng.uniform(0.25, 0.6)), float(rng.uniform(2e3, 8e3))
    u, v = pattern.centroids.T
    around = lines * (u / (np.pi * DIAMETER) + turns * v / LENGTH)
    wall = pattern.panel == pattern.panel_index("wall")
    return np.where(wall, (around % 1 < width) * 1.0, 1.0), pressure


def rows_of(seed: int, edge: float) -> Iterator[Row]:
    """Simulate a drawn design, and return each metric with its told and its real error."""
    comm = MPI.COMM_WORLD
    pattern = cylinder(comm, LENGTH, DIAMETER, edge, mesh="unstructured")
    design, pressure = drawn(seed, pattern)
    solver = _solver(pattern)
    density = design[solver.skin.owned_cells]
    result = solver.solve(density, pressure)
    functions = [function for function, *_ in METRICS.values()]
    told = estimate_error(solver, result, functions)
    positions = solver.skin.gather_vertices(result.positions)
    finest, seconds = timed(lambda: _refined(pattern, design, positions, pressure))
    place = ("refined", f"seed {seed}", f"{len(pattern.triangles)}")
    for (name, (function, unit, factor)), found in zip(METRICS.items(), told, strict=True):
        true = factor * function(*finest)
        yield Row(*place, name, factor * found.value, unit, true, seconds)
        yield Row(*place, f"{name}, told error", factor * found.error, unit)


def _solver(pattern: Pattern) -> EquilibriumSolver:
    skin = sew(MPI.COMM_WORLD, pattern)
    return EquilibriumSolver(skin, Composite(), clamp(pattern, ["base"]))


def _refined(
    pattern: Pattern, design: Floats, positions: Floats, pressure: float
) -> tuple[Pattern, Floats]:
    """Return pattern and shape with edges a quarter as long."""
    for _ in range(2):
        finer = refine(pattern)
        pattern, design = finer.pattern, design[finer.cell]
        solver = _solver(pattern)
        start = finer.at_vertices(positions)[solver.skin.owned_vertices]
        result = solver.solve(design[solver.skin.owned_cells], pressure, start=start)
        positions = solver.skin.gather_vertices(result.positions)
    return pattern, positions


def cases(quick: bool) -> list[Case]:
    """Return a case for each drawn design."""
    edge = QUICK_EDGE if quick else EDGE
    return [
        Case("refined", partial(rows_of, seed, edge), f"seed {seed}")
        for seed in (SEEDS[:3] if quick else SEEDS)
    ]


def held_between(held: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of a frequency that was observed (Clopper & Pearson 1934)."""
    tail = (1 - level) / 2
    low = beta.ppf(tail, held, count - held + 1) if held else 0.0
    high = beta.ppf(1 - tail, held + 1, count - held) if held < count else 1.0
    return float(low), float(high)


def table(rows: Rows) -> str:
    """Return how often the told error holds the real one, for each metric."""
    told = {(row.variant, row.size, row.figure): row.value for row in rows}
    lines = []
    for name in METRICS:
        shares = []
        for row in rows:
            error = told.get((row.variant, row.size, f"{name}, told error"))
            if row.figure == name and error and row.value is not None and row.reference is not None:
                shares.append(abs(row.value - row.reference) / error)
        held = sum(share <= 1 for share in shares)
        low, high = held_between(held, len(shares))
        lines.append((
            name, len(shares), held, f"{100 * low:.0f} to {100 * high:.0f} %",
            f"{np.median(shares):.2f}, {max(shares):.2f}",
        ))  # fmt: skip
    head = ("figure", "designs", "held", "held, 95 %", "error over told: median, largest")
    return markdown(head, lines)


COMMAND = Command(
    about=__doc__,
    cases=cases,
    tables=(Table("accuracy.md", "told intervals", table),),
)
