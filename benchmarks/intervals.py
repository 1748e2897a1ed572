"""Told intervals against limits from finer meshes.

A run tells each figure of a print with an interval, from coarser meshes and from two elements on
its own (`products.actuators.estimates`). Here prints of seven kinds are drawn by seeds on a small
tube, at several pressures. Each is simulated on three meshes, as a run does it, and on two finer
ones, from whose computed shapes the limit is extrapolated. The intervals should hold it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from mpi4py import MPI
from scipy.stats import beta
from shapely.geometry import LineString, MultiLineString
from shapely.geometry.base import BaseGeometry

from benchmarks.bench import Case, Command, Row, Rows, Table, markdown, timed
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.making.print.printability import printed_fractions
from toros_fem.materials.sheet import Composite, Membrane
from toros_fem.measures.metrics import bend_angle, length_ratio, twist_angle
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.error_estimate import LimitShape, half_width, limit_shape
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import Pattern, cylinder, sew
from toros_fem.meshes.following import snapped
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.estimates import COARSER
from toros_fem.products.actuators.other_mesh import COARSER_MESHES

Floats = npt.NDArray[np.float64]
Lines = list[Any]
LENGTH, DIAMETER = 0.03, 0.014  # m
AROUND = np.pi * DIAMETER
# Edges in m: those whose intervals are checked, and those that the limit is extrapolated from.
EDGES, FINE = (1.4e-3, 1.0e-3, 0.75e-3), (0.6e-3, 0.45e-3)
QUICK = (2.8e-3,), (2.0e-3, 1.6e-3)
SEEDS = range(27)
# Half-widths were chosen with the prints of these seeds, and with no others.
CHOSEN = range(18)
# The first seed has one mesh more, and its limits come from finer ones.
FINER, FINEST, SEEDS_OF_FINER = (*EDGES, 0.5e-3), (0.36e-3, 0.27e-3), range(1)
# Order of the errors on the two meshes that the limit is extrapolated from.
ORDER = 1.5
SEEN, NEW = "prints of the choice", "other prints"
# Names of figures: the part of a half-width that one mesh tells, and changes to coarser meshes.
OWN, CHANGE = "half-width on its own", "change to edges of {:g}"
# What is needed to try another rule.
ACROSS, FROM_REST, CORRECTION = "edges over width", "change from rest", "correction"


def helices(rng: np.random.Generator) -> Lines:
    """Return parallel helices, which twist the tube."""
    count, turns = int(rng.integers(3, 6)), rng.uniform(0.3, 0.9) * rng.choice([-1, 1])
    return _around(count, turns)


def braid(rng: np.random.Generator) -> Lines:
    """Return helices of both hands, bonded where they cross, which shorten the tube."""
    count, turns = int(rng.integers(3, 5)), rng.uniform(0.5, 1.0)
    return _around(count, turns) + _around(count, -turns)


def ribs(rng: np.random.Generator, slope: float = 0.0, lean: float = 0.0) -> Lines:
    """Return a spine with ribs on one side, which bend the tube."""
    count = int(rng.integers(5, 8))
    middle, reach = AROUND / 2, 0.35 * AROUND
    found = [[(middle - slope / 2, 0.0), (middle + slope / 2, LENGTH)]]
    for k in range(count):
        at = LENGTH * (k + 0.5) / count
        found.append([(middle - reach, at - lean), (middle + reach, at + lean)])
    return found


def leaning_ribs(rng: np.random.Generator) -> Lines:
    """Return an oblique spine with leaning ribs, which bend and twist the tube."""
    slope = rng.uniform(0.1, 0.3) * AROUND * rng.choice([-1, 1])
    return ribs(rng, slope, 0.04 * LENGTH)


def rings(rng: np.random.Generator) -> Lines:
    """Return rings, between which the tube bulges and lengthens."""
    count = int(rng.integers(5, 9))
    heights = LENGTH * (np.arange(count) + 0.5) / count
    return [[(-0.1 * AROUND, at), (1.1 * AROUND, at)] for at in heights]


def waves(rng: np.random.Generator) -> Lines:
    """Return wavy lines along the tube, which straighten."""
    count, periods = int(rng.integers(3, 6)), rng.uniform(1.0, 2.5)
    along, size = np.linspace(-0.05, 1.05, 60), rng.uniform(0.3, 0.45) / count
    wave = size * np.sin(2 * np.pi * periods * along)
    return [np.column_stack([AROUND * (k / count + wave), LENGTH * along]) for k in range(count)]


class Kind(NamedTuple):
    """Prints of one kind: how lines are drawn, their least and largest width in m and pressure."""

    lines: Callable[[np.random.Generator], Lines]
    widths: tuple[float, float] = (1.0e-3, 2.2e-3)
    pressures: tuple[float, float] = (3e3, 8e3)


KINDS: Mapping[str, Kind] = {
    "helices": Kind(helices),
    "braid": Kind(braid),
    "ribs": Kind(ribs),
    "leaning ribs": Kind(leaning_ribs),
    "rings": Kind(rings),
    "waves": Kind(waves),
    # Pressure times radius is 70 to 98 N/m; in the demos that design lines it is 100 N/m and more.
    "soft leaning ribs": Kind(leaning_ribs, (1.0e-3, 1.4e-3), (10e3, 14e3)),
}


def tip_of(pattern: Pattern, positions: Floats) -> Floats:
    """Return the centre of the tip in mm."""
    tip = pattern.vertices_of("tip")
    areas = pattern.vertex_areas[tip]
    return np.asarray(1e3 * areas @ positions[tip] / areas.sum())


# What is told, with its unit, its factor, and the change from rest that is worth telling.
FIGURES: Mapping[str, tuple[Callable[[Pattern, Floats], Any], str, float, float]] = {
    "angle": (bend_angle, "deg", 180 / np.pi, 5.0),
    "twist": (twist_angle, "deg", 180 / np.pi, 5.0),
    "length": (length_ratio, "percent", 100.0, 2.0),
    "tip": (tip_of, "mm", 1.0, 2.0),
}


def _around(count: int, turns: float) -> Lines:
    starts = AROUND * np.arange(count) / count
    return [
        [(at - 0.1 * turns * AROUND, -0.1 * LENGTH), (at + 1.1 * turns * AROUND, 1.1 * LENGTH)]
        for at in starts
    ]


def drawn(kind: str, seed: int, pattern: Pattern) -> tuple[list[BaseGeometry], float]:
    """Return lines on the tube's wall between printed ends, and a pressure in Pa."""
    rng = np.random.default_rng([54, list(KINDS).index(kind), seed])
    of_kind = KINDS[kind]
    width, pressure = rng.uniform(*of_kind.widths), rng.uniform(*of_kind.pressures)
    lines = of_kind.lines(rng)
    regions = [pattern.outline(k) for k in range(len(pattern.panel_names))]
    wall = pattern.panel_index("wall")
    corner = np.array(regions[wall].bounds[:2])
    shifts = [corner + [turn * AROUND, 0.0] for turn in (-2, -1, 0, 1, 2)]
    copies = [LineString(np.asarray(line) + shift) for line in lines for shift in shifts]
    ribbon = MultiLineString(copies).buffer(width / 2, cap_style="flat")
    regions[wall] = shapely.intersection(regions[wall], ribbon)
    return regions, float(pressure)


def simulated(
    kind: str, seed: int, edge: float, near: LimitShape | None
) -> tuple[LimitShape, float, float]:
    """Return the shape of a print on a mesh, and wall times of solve and estimate in s."""
    comm = MPI.COMM_WORLD
    pattern = cylinder(comm, LENGTH, DIAMETER, edge, mesh="unstructured")
    regions, pressure = drawn(kind, seed, pattern)
    pattern = snapped(comm, pattern, regions)
    skin, sheet = sew(comm, pattern), Composite(membrane=Membrane(strain="smoothed"))
    solver = EquilibriumSolver(skin, sheet, clamp(pattern, ["base"]))
    start = None
    if near is not None:
        start = solver.start_at(make_transfer(near.pattern, pattern).positions(near.computed))
    density = printed_fractions(pattern, regions)[skin.owned_cells]
    result, solving = timed(lambda: solver.solve(density, pressure, start))
    found, estimating = timed(lambda: limit_shape(solver, result))
    return found, solving, estimating


def rows_of(
    kind: str, seed: int, edges: tuple[float, ...], fine: tuple[float, float]
) -> Iterator[Row]:
    """Simulate a print on all meshes, and return each figure, parts of its interval, and its limit.

    A coarser mesh without an equilibrium is left out, as a run leaves it out.
    """
    found: dict[float, tuple[LimitShape, float, float]] = {}
    near = None
    coarser = [edge * COARSER**k for edge in edges for k in range(1, COARSER_MESHES + 1)]
    for edge in sorted({*edges, *coarser, *fine}, reverse=True):
        with suppress(*(() if edge in (*edges, *fine) else (NoEquilibriumError,))):
            found[edge] = simulated(kind, seed, edge, near)
            near = found[edge][0]
    (one, *_), (two, *_) = (found[edge] for edge in fine)
    for name, (measure, unit, factor, least) in FIGURES.items():

        def told(shape: LimitShape, positions: Floats) -> Floats:
            return np.asarray(factor * np.asarray(measure(shape.pattern, positions)))  # noqa: B023

        ends = [told(shape, shape.computed) for shape in (one, two)]
        limit = ends[1] + (ends[1] - ends[0]) / ((fine[0] / fine[1]) ** ORDER - 1)
        rest = told(one, one.pattern.points)
        if np.linalg.norm(limit - rest) < least:
            continue
        for edge in edges:
            shape, solving, estimating = found[edge]
            value = told(shape, shape.limit)
            values = {
                "error": value - limit,
                "error as computed": told(shape, shape.computed) - limit,
                "limit": limit - rest,
                OWN: factor * shape.half_width(measure),
                ACROSS: shape.edges_to_width,
                FROM_REST: value - rest,
                CORRECTION: factor * shape.correction(measure),
            }
            for k in range(1, COARSER_MESHES + 1):
                if other := found.get(edge * COARSER**k):
                    values[CHANGE.format(COARSER**k)] = value - told(other[0], other[0].limit)
            for what, at in values.items():
                seconds = {"error": solving, OWN: estimating}.get(what)
                place = (kind, f"seed {seed}", f"{1e3 * edge:.2f} mm", f"{name}, {what}")
                own = "" if what == ACROSS else unit
                yield Row(*place, float(np.linalg.norm(at)), own, seconds=seconds)


def cases(quick: bool) -> list[Case]:
    """Return a case for each print."""
    found = []
    for seed in SEEDS[:1] if quick else SEEDS:
        full = (FINER, FINEST) if seed in SEEDS_OF_FINER else (EDGES, FINE)
        edges, fine = QUICK if quick else full
        found += [
            Case(kind, partial(rows_of, kind, seed, edges, fine), f"seed {seed}") for kind in KINDS
        ]
    return found


def held_between(held: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of a frequency that was observed (Clopper & Pearson 1934)."""
    tail = (1 - level) / 2
    low = beta.ppf(tail, held, count - held + 1) if held else 0.0
    high = beta.ppf(1 - tail, held + 1, count - held) if held < count else 1.0
    return float(low), float(high)


class Told(NamedTuple):
    """A figure that was told, and its limit.

    Attributes:
        kind: Kind of the print.
        size: Edge length.
        name: Name of the figure.
        error: Distance of what is told from the limit.
        width: Half-width of the interval.
        computed: Distance of what the mesh computes from the limit.
        change: Change from rest to the limit.
        seconds: Time of the solve; NaN of one that was not alone on the machine.
        seeds: `SEEN` if the constants of half-widths were chosen with its print, `NEW` if not.
    """

    kind: str
    size: str
    name: str
    error: float
    width: float
    computed: float
    change: float
    seconds: float
    seeds: str


def told_figures(rows: Rows) -> list[Told]:
    """Return all figures of the study."""
    by_place = {(row.case, row.variant, row.size, row.figure): row for row in rows}
    found = []
    for (kind, seed, size, figure), row in by_place.items():
        name, _, what = figure.partition(", ")
        if what == "error":
            own, computed, change = (
                by_place[kind, seed, size, f"{name}, {other}"].value or 0.0
                for other in (OWN, "error as computed", "limit")
            )
            changes = {
                COARSER**k: by_place[place].value or 0.0
                for k in range(1, COARSER_MESHES + 1)
                if (place := (kind, seed, size, f"{name}, {CHANGE.format(COARSER**k)}")) in by_place
            }
            width = half_width(own, changes)
            seconds = np.nan if row.seconds is None else row.seconds
            numbers = row.value or 0.0, width, computed, change, seconds
            seeds = SEEN if int(seed.split()[-1]) in CHOSEN else NEW
            found.append(Told(kind, size, name, *numbers, seeds))
    return found


def table(rows: Rows) -> str:
    """Return how often intervals hold the limit, and how wide they are, by kind, mesh and seeds."""
    found, lines = told_figures(rows), []
    groups = [(k, 0) for k in KINDS] + [(s, 1) for s in dict.fromkeys(f[1] for f in found)]
    for label, column in [*groups, (SEEN, 8), (NEW, 8), ("all", None)]:
        own = [one[3:7] for one in found if column is None or one[column] == label]
        if not own:
            continue
        error, width, computed, change = np.array(own).T
        held = int((error <= width).sum())
        low, high = held_between(held, len(own))
        off, told, wide = (f"{np.median(100 * x / change):.1f} %" for x in (computed, error, width))
        ratio = f"{np.median(width) / np.median(error):.1f}"
        counted = f"{held / len(own):.0%}", f"{low:.0%} to {high:.0%}"
        lines.append((label, len(own), *counted, off, told, wide, ratio))
    head = (
        "", "values", "held", "95 %", "error as computed: median", "error as reported: median",
        "half-width: median", "half-width over error",
    )  # fmt: skip
    return markdown(head, lines)


COMMAND = Command(
    about=__doc__,
    cases=cases,
    tables=(Table("accuracy.md", "told intervals", table),),
)
