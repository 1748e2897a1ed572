"""Run time against error of a tile's profile: the same patterns on finer and finer meshes.

Three patterns on a tile of 1 cm, on meshes along their borders, quadratic in the print: stripes,
which are exact on every mesh; crossing lines; and rings, which nearly touch their neighbours. The
pull is 10 % at 0°, 15° and 45°. Errors are relative to the limit extrapolated from the three finest
meshes. Seconds are those of all three directions on one core: from the flat sheet, and from a
similar design with all gradients.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from shapely import Point, box
from shapely.affinity import scale
from shapely.geometry.base import BaseGeometry

from benchmarks.bench import Case, Row, Rows, markdown, timed, values_of
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.terms.periodic import Periodic
from toros_fem.meshes import sew, tile
from toros_fem.products.tiles.stiffness_profile import ProfileSolver, tile_solver

Floats = npt.NDArray[np.float64]

SIDE, STRAIN = 0.01, 0.1
ANGLES = np.radians([0.0, 15.0, 45.0])
EDGES = (5, 10, 20, 40, 80)
MIDDLE = Point(0.5, 0.5)
# The print, in units of the side.
PATTERNS: dict[str, BaseGeometry] = {
    "stripes": box(0, 0.3, 1, 0.7),
    "lines": box(0.4, 0, 0.6, 1) | box(0, 0.4, 1, 0.6),
    "rings": (MIDDLE.buffer(0.52, 64) - MIDDLE.buffer(0.3, 64)) & box(0, 0, 1, 1),
}


def measure(pattern: str, edges: int) -> tuple[Floats, int, float, float]:
    """Return the stiffness in N/m in each direction, triangles, seconds from flat and from near."""
    plain = tile(MPI.COMM_SELF, SIDE, SIDE / EDGES[0])
    region = scale(PATTERNS[pattern], SIDE, SIDE, origin=(0, 0))
    patch, inside = plain.following(MPI.COMM_SELF, region, SIDE / edges)
    skin = sew(MPI.COMM_SELF, patch.pattern)
    density = inside[skin.owned_cells].astype(np.float64)
    solver = tile_solver(skin, Composite(bending=None), Periodic(patch), quadratic=inside)
    profile = ProfileSolver(solver, ANGLES, STRAIN)
    found, cold = timed(lambda: profile.solve(density, gradients=False))
    _, warm = timed(lambda: profile.solve(0.999 * density, found))
    return found.stiffness, len(inside), cold, warm


def limit_of(values: Floats) -> Floats:
    """Return the limit of a geometric series, from its last three members.

    Differences that shrink by less than half of themselves are taken to do so.
    """
    first, second, last = values[-3:]
    steps = second - last
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.fmax((first - second) / steps, 2.0)
        return np.asarray(last - steps / (ratio - 1))


def rows_of(pattern: str, edges: tuple[int, ...]) -> Iterator[Row]:
    """Return the worst error over the directions, and seconds, on each mesh."""
    found = [measure(pattern, count) for count in edges]
    values = np.array([stiffness for stiffness, *_ in found])
    errors = np.abs(values / limit_of(values) - 1).max(axis=1)
    for count, error, (_, triangles, cold, warm) in zip(edges, errors, found, strict=True):
        place = (f"tile-{pattern}", "", f"{count}")
        yield Row(*place, "worst error", float(error), "", 0.0, cold)
        yield Row(*place, "triangles", triangles, "")
        yield Row(*place, "from a similar design", warm, "s")


def tile_cases(quick: bool) -> list[Case]:
    """Return a case for each pattern; all meshes are needed for its limit."""
    edges = EDGES[:3] if quick else EDGES
    return [Case(f"tile-{pattern}", partial(rows_of, pattern, edges)) for pattern in PATTERNS]


def tile_table(rows: Rows) -> str:
    """Return errors and seconds by the number of edges."""
    found = values_of(rows, "tile-")
    cold = {row.size: row.seconds for row in rows if row.case == "tile-lines" and row.seconds}
    lines = []
    for size, seconds in cold.items():
        lined, ringed = found["tile-lines", "", size], found["tile-rings", "", size]
        triangles = f"{round(lined['triangles'] or 0):,}".replace(",", " ")
        errors = (f"{100 * (of['worst error'] or 0):.2g} %" for of in (lined, ringed))
        near = lined["from a similar design"] or 0
        lines.append((size, triangles, *errors, f"{seconds:.2g} s", f"{near:.2g} s"))
    heads = (
        "edges along a side",
        "triangles, crossing lines",
        "crossing lines, worst direction",
        "rings, worst direction",
        "from flat",
        "from a similar design, with gradients",
    )
    return markdown(heads, lines)
