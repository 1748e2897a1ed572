"""Told intervals against values of a finer mesh.

A run tells each figure of a print with an interval, from coarser meshes of the same print
(`products.actuators.estimates`). Here prints of eight kinds are drawn by seeds on a small tube and
on a flat finger, at several pressures. Each is simulated on two meshes, as a run does it, and on a
finer one, whose value the intervals should hold.
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
from toros_fem.materials.sheet import Composite
from toros_fem.measures.metrics import bend_angle, length_ratio, twist_angle
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.error_estimate import edge_of, half_width
from toros_fem.mechanics.skin.supports import Supports, clamp, clamp_where
from toros_fem.meshes import Pattern, cylinder, sew, two_panels
from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.estimates import COARSER, COARSER_MESHES

Floats = npt.NDArray[np.float64]
Lines = list[Any]
# A mesh, and the positions of its vertices, (n, 3), in m.
Shape = tuple[Pattern, Floats]
LENGTH, DIAMETER = 0.03, 0.014  # m
AROUND = np.pi * DIAMETER
WIDTH, ROOT = 0.016, 0.003  # of a flat finger and its held end, m
# Edges in m: those whose intervals are checked, and those of the mesh that tells the limit.
EDGES, FINE = (2.0e-3, 1.4e-3), 0.7e-3
QUICK = (2.8e-3,), 1.6e-3
SEEDS = range(27)
SLENDER: Mapping[str, Any] = {
    "length": 0.105, "edges": EDGES[:1], "fine": 1.0e-3, "seeds": range(8), "pressures": (3e3, 5e3),
}  # fmt: skip
# Half-widths were chosen with the prints of these seeds, and with no others.
CHOSEN = range(15)
SEEN, NEW = "prints of the choice", "other prints"
# Names of figures: the change to coarser meshes, and the edge length of a mesh that has borders.
CHANGE, EDGE = "change to edges of {:g}", "edge"


def helices(rng: np.random.Generator, length: float) -> Lines:
    """Return parallel helices, which twist the tube."""
    count, turns = int(rng.integers(3, 6)), rng.uniform(0.3, 0.9) * rng.choice([-1, 1])
    return _around(count, turns * length / LENGTH, length)


def braid(rng: np.random.Generator, length: float) -> Lines:
    """Return helices of both hands, bonded where they cross, which shorten the tube."""
    count, turns = int(rng.integers(3, 5)), rng.uniform(0.5, 1.0) * length / LENGTH
    return _around(count, turns, length) + _around(count, -turns, length)


def ribs(rng: np.random.Generator, length: float, slope: float = 0.0, lean: float = 0.0) -> Lines:
    """Return a spine with ribs on one side, which bend the tube."""
    count = round(int(rng.integers(5, 8)) * length / LENGTH)
    middle, reach = AROUND / 2, 0.35 * AROUND
    found = [[(middle - slope / 2, 0.0), (middle + slope / 2, length)]]
    for k in range(count):
        at = length * (k + 0.5) / count
        found.append([(middle - reach, at - lean), (middle + reach, at + lean)])
    return found


def leaning_ribs(rng: np.random.Generator, length: float) -> Lines:
    """Return an oblique spine with leaning ribs, which bend and twist the tube."""
    slope = rng.uniform(0.1, 0.3) * AROUND * rng.choice([-1, 1])
    return ribs(rng, length, slope, 0.04 * LENGTH)


def rings(rng: np.random.Generator, length: float) -> Lines:
    """Return rings, between which the tube bulges and lengthens."""
    count = round(int(rng.integers(5, 9)) * length / LENGTH)
    heights = length * (np.arange(count) + 0.5) / count
    return [[(-0.1 * AROUND, at), (1.1 * AROUND, at)] for at in heights]


def waves(rng: np.random.Generator, length: float) -> Lines:
    """Return wavy lines along the tube, which straighten."""
    count, periods = int(rng.integers(3, 6)), rng.uniform(1.0, 2.5) * length / LENGTH
    along, size = np.linspace(-0.05, 1.05, 60), rng.uniform(0.3, 0.45) / count
    wave = size * np.sin(2 * np.pi * periods * along)
    return [np.column_stack([AROUND * (k / count + wave), length * along]) for k in range(count)]


def flat_ribs(rng: np.random.Generator, length: float) -> Lines:
    """Return a spine with ribs on one of two flat panels, which bend the finger."""
    count, middle = int(rng.integers(5, 8)), WIDTH / 2
    found: Lines = [[(0.0, middle), (length, middle)]]
    for k in range(count):
        at, lean = length * (k + 0.5) / count, rng.uniform(-0.05, 0.05) * length
        found.append([(at - lean, 0.1 * WIDTH), (at + lean, 0.9 * WIDTH)])
    return found


def tube(comm: MPI.Comm, length: float, edge: float) -> Pattern:
    """Return a tube that is closed by two caps."""
    return cylinder(comm, length, DIAMETER, edge, mesh="unstructured")


def finger(comm: MPI.Comm, length: float, edge: float) -> Pattern:
    """Return two flat panels, sewn along their outline, with a base of one."""
    outline = np.array([[0, 0], [length, 0], [length, WIDTH], [0, WIDTH]])
    return two_panels(comm, outline, edge)


class Kind(NamedTuple):
    """Prints of one kind: how lines are drawn, their least and largest width in m and pressure."""

    lines: Callable[[np.random.Generator, float], Lines]
    widths: tuple[float, float] = (1.0e-3, 2.2e-3)
    pressures: tuple[float, float] = (3e3, 8e3)
    pattern: Callable[[MPI.Comm, float, float], Pattern] = tube
    panel: str = "wall"
    length: float = LENGTH
    edges: tuple[float, ...] = EDGES
    fine: float = FINE
    seeds: range = SEEDS


KINDS: Mapping[str, Kind] = {
    "helices": Kind(helices),
    "braid": Kind(braid),
    "ribs": Kind(ribs),
    "leaning ribs": Kind(leaning_ribs),
    "rings": Kind(rings),
    "waves": Kind(waves),
    # Pressure times radius is 70 to 98 N/m; in the demos that design lines it is 100 N/m and more.
    "soft leaning ribs": Kind(leaning_ribs, (1.0e-3, 1.4e-3), (10e3, 14e3)),
    "flat finger": Kind(flat_ribs, pattern=finger, panel="top"),
    # As slender as the tubes of the demos.
    "long helices": Kind(helices, **SLENDER),
    "long ribs": Kind(ribs, **SLENDER),
    "long leaning ribs": Kind(leaning_ribs, **SLENDER),
}


def tip_of(pattern: Pattern, positions: Floats) -> Floats:
    """Return the centre of the tip in mm."""
    tip = pattern.vertices_of("tip")
    areas = pattern.vertex_areas[tip]
    return np.asarray(1e3 * areas @ positions[tip] / areas.sum())


def corners_of(pattern: Pattern, positions: Floats) -> Floats:
    """Return the middle of both corners at the tip of a finger in mm."""
    both = np.array([[LENGTH, 0.0], [LENGTH, WIDTH]])
    away = np.linalg.norm(pattern.points[:, None, :2] - both, axis=2)
    corner = away.argmin(axis=0)
    return np.asarray(1e3 * positions[corner].mean(axis=0))


# What is told, with its unit, its factor, and the change from rest that is worth telling.
Figures = Mapping[str, tuple[Callable[[Pattern, Floats], Any], str, float, float]]
OF_TUBES: Figures = {
    "angle": (bend_angle, "deg", 180 / np.pi, 5.0),
    "twist": (twist_angle, "deg", 180 / np.pi, 5.0),
    "length": (length_ratio, "percent", 100.0, 2.0),
    "tip": (tip_of, "mm", 1.0, 2.0),
}
OF_FINGERS: Figures = {"tip": (corners_of, "mm", 1.0, 2.0)}


def _around(count: int, turns: float, length: float) -> Lines:
    starts = AROUND * np.arange(count) / count
    return [
        [(at - 0.1 * turns * AROUND, -0.1 * length), (at + 1.1 * turns * AROUND, 1.1 * length)]
        for at in starts
    ]


def drawn(kind: str, seed: int, pattern: Pattern) -> tuple[list[BaseGeometry], float]:
    """Return lines on one panel, and a pressure in Pa; the ends of a tube are printed."""
    rng = np.random.default_rng([54, list(KINDS).index(kind), seed])
    of_kind = KINDS[kind]
    width, pressure = rng.uniform(*of_kind.widths), rng.uniform(*of_kind.pressures)
    lines = of_kind.lines(rng, of_kind.length)
    regions = [pattern.outline(k) for k in range(len(pattern.panel_names))]
    panel = pattern.panel_index(of_kind.panel)
    corner = np.array(regions[panel].bounds[:2])
    turns = (-2, -1, 0, 1, 2)
    if of_kind.pattern is finger:
        turns, regions[1 - panel] = (0,), shapely.Polygon()
    shifts = [corner + [turn * AROUND, 0.0] for turn in turns]
    copies = [LineString(np.asarray(line) + shift) for line in lines for shift in shifts]
    ribbon = MultiLineString(copies).buffer(width / 2, cap_style="flat")
    regions[panel] = shapely.intersection(regions[panel], ribbon)
    if of_kind.pattern is finger:  # its root is printed and held
        root = shapely.box(0.0, -WIDTH, ROOT, WIDTH)
        regions = [r | (root & pattern.outline(k)) for k, r in enumerate(regions)]
    return regions, float(pressure)


def supports_of(pattern: Pattern) -> Supports:
    """Hold the base of a tube, or one end of a finger."""
    if "base" in pattern.panel_names:
        return clamp(pattern, ["base"])
    return clamp_where(pattern, lambda points: points[:, 0] <= (1 + 1e-6) * ROOT)


def simulated(
    kind: str, seed: int, edge: float, coarser: float, near: Shape | None
) -> tuple[Shape, float]:
    """Return the shape of a print on a mesh, and the wall time of the solve in s."""
    comm = MPI.COMM_WORLD
    pattern = KINDS[kind].pattern(comm, KINDS[kind].length, edge)
    regions, pressure = drawn(kind, seed, pattern)
    finer, inside = bordered(comm, pattern, regions, coarser=coarser)
    pattern = finer.pattern
    bare = np.bincount(pattern.panel, ~inside) > 0
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(
        skin, Composite(), supports_of(pattern), quadratic=inside & bare[pattern.panel]
    )
    start = None
    if near is not None:
        start = solver.start_at(make_transfer(near[0], pattern).positions(near[1]))
    density = inside.astype(np.float64)[skin.owned_cells]
    result, seconds = timed(lambda: solver.solve(density, pressure, start))
    return (pattern, skin.gather_vertices(result.positions)), seconds


def rows_of(kind: str, seed: int, edges: tuple[float, ...], fine: float) -> Iterator[Row]:
    """Simulate a print on all meshes, and return each figure, its changes, and its limit.

    A coarser mesh without an equilibrium is left out, as a run leaves it out.
    """
    found: dict[tuple[float, int], tuple[Shape, float]] = {}
    near = None
    meshes = [(edge, k) for edge in edges for k in range(COARSER_MESHES + 1)]
    for edge, k in sorted(meshes, key=lambda one: -one[0] * COARSER ** one[1]):
        with suppress(*(() if k == 0 else (NoEquilibriumError,))):
            found[edge, k] = simulated(kind, seed, edge * COARSER**k, COARSER**k, near)
            near = found[edge, k][0]
    finest, _ = simulated(kind, seed, fine, fine / min(edges), near)
    for edge in edges:
        mean = 1e3 * edge_of(found[edge, 0][0][0].areas)
        yield Row(kind, f"seed {seed}", f"{1e3 * edge:.2f} mm", EDGE, mean, "mm")
    figures = OF_FINGERS if KINDS[kind].pattern is finger else OF_TUBES
    for name, (measure, unit, factor, least) in figures.items():

        def told(shape: Shape) -> Floats:
            return np.asarray(factor * np.asarray(measure(*shape)))  # noqa: B023

        limit, rest = told(finest), told((finest[0], finest[0].points))
        if np.linalg.norm(limit - rest) < least:
            continue
        for edge in edges:
            shape, seconds = found[edge, 0]
            values = {"error": told(shape) - limit, "limit": limit - rest}
            for k in range(1, COARSER_MESHES + 1):
                if other := found.get((edge, k)):
                    values[CHANGE.format(COARSER**k)] = told(shape) - told(other[0])
            for what, at in values.items():
                place = (kind, f"seed {seed}", f"{1e3 * edge:.2f} mm", f"{name}, {what}")
                size = float(np.linalg.norm(at))
                yield Row(*place, size, unit, seconds=seconds if what == "error" else None)


def cases(quick: bool) -> list[Case]:
    """Return a case for each print."""
    found = []
    for seed in SEEDS[:1] if quick else SEEDS:
        for kind, of in KINDS.items():
            edges, fine = QUICK if quick else (of.edges, of.fine)
            if seed in of.seeds:
                run = partial(rows_of, kind, seed, edges, fine)
                found.append(Case(kind, run, f"seed {seed}"))
    return found


def held_between(held: int, count: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of a frequency that was observed (Clopper & Pearson 1934)."""
    tail = (1 - level) / 2
    low = beta.ppf(tail, held, count - held + 1) if held else 0.0
    high = beta.ppf(1 - tail, held + 1, count - held) if held < count else 1.0
    return float(low), float(high)


class Told(NamedTuple):
    """A figure that was told, and that of the finer mesh.

    Attributes:
        kind: Kind of the print.
        size: Edge length.
        name: Name of the figure.
        error: Distance of what is told from the finer mesh's value.
        width: Half-width of the interval.
        change: Change from rest.
        seconds: Time of the solve; NaN of one that was not alone on the machine.
        seeds: `SEEN` if the constants of half-widths were chosen with its print, `NEW` if not.
    """

    kind: str
    size: str
    name: str
    error: float
    width: float
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
            change = by_place[kind, seed, size, f"{name}, limit"].value or 0.0
            changes = {
                COARSER**k: by_place[place].value or 0.0
                for k in range(1, COARSER_MESHES + 1)
                if (place := (kind, seed, size, f"{name}, {CHANGE.format(COARSER**k)}")) in by_place
            }
            if not changes:
                continue
            key = f"{name}_{row.unit}"
            seconds = np.nan if row.seconds is None else row.seconds
            seeds = SEEN if int(seed.split()[-1]) in CHOSEN else NEW
            extents = DIAMETER, DIAMETER, KINDS[kind].length
            edge = 1e-3 * (by_place[kind, seed, size, EDGE].value or 0.0)
            width = half_width(changes, key, extents, edge)
            numbers = row.value or 0.0, width, change, seconds
            found.append(Told(kind, size, name, *numbers, seeds))
    return found


def table(rows: Rows) -> str:
    """Return how often intervals hold the limit, and how wide they are, by kind, mesh and seeds."""
    found, lines = told_figures(rows), []
    groups = [(k, 0) for k in KINDS] + [(s, 1) for s in dict.fromkeys(f[1] for f in found)]
    for label, column in [*groups, (SEEN, 7), (NEW, 7), ("all", None)]:
        own = [one[3:6] for one in found if column is None or one[column] == label]
        if not own:
            continue
        error, width, change = np.array(own).T
        held = int((error <= width).sum())
        low, high = held_between(held, len(own))
        told, wide = (f"{np.median(100 * x / change):.1f} %" for x in (error, width))
        ratio = f"{np.median(width) / np.median(error):.1f}"
        counted = f"{held / len(own):.0%}", f"{low:.0%} to {high:.0%}"
        lines.append((label, len(own), *counted, told, wide, ratio))
    head = (
        "", "values", "held", "95 %", "error: median", "half-width: median", "half-width over error"
    )  # fmt: skip
    return markdown(head, lines)


COMMAND = Command(
    about=__doc__,
    cases=cases,
    tables=(Table("accuracy.md", "told intervals", table),),
)
