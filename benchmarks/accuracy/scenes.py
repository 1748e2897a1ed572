"""Common parts of the cases: tables, materials, skins, one timed solve."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from benchmarks.accuracy.known import Known, Measured, timed
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes import Pattern, sew

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Place = Callable[[Floats], Floats]

COMM = MPI.COMM_WORLD
DATA = Path(__file__).parents[2] / "tests" / "data"


def membrane_case(
    group: str,
    name: str,
    about: str,
    quantity: str,
    reference: float,
    source: str,
    run: Callable[[str, int], Measured],
    *,
    meshes: tuple[str, ...],
    sizes: tuple[int, ...],
    within: float | None = 1e-3,
    note: str = "",
    default: int | None = None,
) -> Known:
    """A case without bending, run by mesh and size."""
    return Known(
        name=name,
        group=group,
        about=about,
        quantity=quantity,
        reference=reference,
        source=source,
        formulations=("membrane",),
        meshes=meshes,
        sizes=sizes,
        run=lambda _, mesh, size: run(mesh, size),
        within=within,
        note=note,
        default=default,
    )


def rows_where(name: str, **match: str) -> list[dict[str, str]]:
    """Rows of a reference table whose columns hold the given words."""
    with (DATA / f"{name}.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [row for row in rows if all(row[key] == word for key, word in match.items())]


def entry(name: str, column: str, **match: str) -> float:
    """The number in one row of a reference table, its unit left out."""
    (row,) = rows_where(name, **match)
    return float(row[column].split()[0])


def membrane(
    young: float, poisson: float, thickness: float, c1: float, c2: float, contrast: float = 1.0
) -> Composite:
    """A sheet without bending; its reinforcement is stiffer by `contrast`."""
    return Composite(
        fabric=Material(young, poisson, thickness),
        reinforcement=Material(contrast * young, poisson, thickness),
        c1=c1,
        c2=c2,
        bending=None,
    )


def table_a(c1: float = 1.8, c2: float = 2.0, contrast: float = 1.0) -> Composite:
    """Material A of the tables: μ = λ = 50 kPa in plane stress, 0.3 mm."""
    return membrane(400e3 / 3, 1 / 3, 0.3e-3, c1, c2, contrast)


@dataclass(frozen=True, eq=False)
class Solved:
    """An equilibrium.

    Attributes:
        pattern: Of the skin.
        points: Positions of all assembled vertices, (n, 3), in m.
        reactions: Forces of the supports there, (n, 3), in N.
        result: What the solver tells.
        seconds: Wall time of the solve.
    """

    pattern: Pattern
    points: Floats
    reactions: Floats
    result: Equilibrium
    seconds: float

    def measured(self, value: float) -> Measured:
        """A value found on this equilibrium."""
        return Measured(float(value), len(self.pattern.panel), self.seconds)


def solve(
    pattern: Pattern,
    composite: Composite,
    supports: Supports,
    pressure: float,
    density: Floats | None = None,
    options: NewtonOptions | None = None,
) -> Solved:
    """The equilibrium from the assembled positions (collective); only the solve is timed.

    Args:
        pattern: Flat panels and where to start.
        composite: Materials.
        supports: What is held.
        pressure: In Pa.
        density: Of all triangles of the pattern; None: fabric everywhere.
        options: Of the solver.
    """
    skin = sew(COMM, pattern)
    solver = EquilibriumSolver(skin, composite, supports, options)
    every = np.zeros(len(pattern.panel)) if density is None else density
    result, seconds = timed(lambda: solver.solve(every[skin.owned_cells], pressure))
    points = skin.gather_vertices(result.positions)
    model = solver.model
    reactions = skin.gather_vertices(model.positions(model.reaction(result.state)))
    return Solved(pattern, points, reactions, result, seconds)


def without(pattern: Pattern, name: str) -> Pattern:
    """A pattern that lacks one of its panels."""
    gone = pattern.panel_index(name)
    stays = pattern.panel != gone
    flat, corners = np.unique(pattern.flat_triangles[stays], return_inverse=True)
    vertices, sewn = np.unique(pattern.sewn[flat], return_inverse=True)
    panel = pattern.panel[stays]
    return Pattern(
        flat_points=pattern.flat_points[flat],
        flat_triangles=corners.reshape(-1, 3),
        panel=panel - (panel > gone),
        sewn=sewn.ravel(),
        points=pattern.points[vertices],
        panel_names=tuple(n for n in pattern.panel_names if n != name),
    )


def half_held(pattern: Pattern) -> Supports:
    """Fix half a skin in its plane of symmetry z = 0, and prevent sliding and turning there.

    The latter by three components at the border in that plane, statically determinate: they carry
    no force, and a skin that is symmetric about z does not feel them.
    """
    points = pattern.points
    base = np.flatnonzero(np.abs(points[:, 2]) < 1e-9)
    fixed = symmetry_plane(pattern, 2).fixed
    for direction, axis in (((-1, 0), 1), ((1, 0), 1), ((0, 1), 0)):
        fixed[base[np.argmax(points[base, :2] @ direction)], axis] = True
    return Supports(fixed)


def pole(found: Solved, count: int = 12) -> float:
    """Height above the flat origin, by a parabola through the vertices around it."""
    flat = np.zeros((len(found.points), 2))
    flat[found.pattern.sewn] = found.pattern.flat_points
    distance = np.linalg.norm(flat, axis=1)
    near = np.argsort(distance, kind="stable")[:count]
    u, v = (flat[near] / distance[near].max()).T
    terms = np.column_stack([np.ones(count), u, v, u * u, u * v, v * v])
    return float(np.linalg.lstsq(terms, found.points[near, 2], rcond=None)[0][0])
