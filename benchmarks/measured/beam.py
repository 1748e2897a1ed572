"""An inflated tube is pushed aside at its tip until it collapses: wrinkles at its base."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpi4py import MPI

from benchmarks.bench import Row
from benchmarks.measured.compared import FITTED, Compared, Floats, constant, rows_of, secant, table
from benchmarks.measured.skins import Held
from toros_fem.materials.sheet import Composite, Material, Membrane
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, clamp, symmetry_plane
from toros_fem.meshes import cylinder

NAME = "beam"
LENGTH, THICKNESS, POISSON = 1.0, 1e-3, 0.3  # m; the thickness counts only times the modulus
# The tip is a stiff plate.
PLATE = 50.0
FIRST = "160 mm, 30 kPa"


def forces(curve: str, stiffness: float, at: Floats, quick: bool) -> Floats:
    """Return the forces in N at deflections in mm, for E h in kN/m."""
    diameter, _, pressure, _ = curve.replace(",", "").split()
    size = 1e-3 * float(diameter)
    pattern = cylinder(MPI.COMM_SELF, LENGTH, size, size / (3 if quick else 5), planes=(1,))
    sheet, plate = (
        Material(factor * 1e3 * stiffness / THICKNESS, POISSON, THICKNESS)
        for factor in (1.0, PLATE)
    )
    composite = Composite(fabric=sheet, reinforcement=plate, c1=3.0, c2=5.0, bending=None,
                          membrane=Membrane("tension-field"))  # fmt: skip
    tip = pattern.vertices_of("tip")
    middle = tip[np.argmin(np.linalg.norm(pattern.points[tip, :2], axis=1))]
    pushed = np.zeros(pattern.points.shape, dtype=bool)
    pushed[middle, 0] = True
    held = clamp(pattern, ["base"]) | symmetry_plane(pattern, 1) | Supports(pushed)
    skin = Held(pattern, composite, held, np.isin(pattern.triangles, tip).all(axis=1))
    found = []
    for step in (0.0, *at):
        _, reactions = skin.under(Load(1e3 * float(pressure), displacement=1e-3 * step * pushed))
        found.append(2 * reactions[middle, 0])  # of both halves
    return np.array(found[1:])


def run(quick: bool) -> Iterator[Row]:
    """Fit E h to one point, and predict all others."""
    curves = table(NAME)[1]
    first = curves[FIRST][:1]

    def miss(power: float) -> float:
        return float(forces(FIRST, 10**power, first[:, 0], quick)[0] / first[0, 1] - 1)

    stiffness = 10 ** secant(miss, 2.2, 2.3, 1e-3)
    yield constant(NAME, "E h of the cloth", stiffness, "kN/m")
    for curve, points in curves.items():
        if quick and not curve.startswith("160 mm, 5"):
            continue
        values = forces(curve, stiffness, points[:, 0], quick)
        if curve == FIRST:
            yield from rows_of(NAME, f"{curve}, 20 mm", first, values[:1], FITTED)
            points, values = points[1:], values[1:]
        yield from rows_of(NAME, curve, points, values)


CASE = Compared(
    name=NAME,
    title="Inflated beam",
    known="sizes and pressures of twelve tubes",
    assumed="Poisson's ratio 0.3; a stiff tip; cloth equally stiff in all directions",
    free="E h of the cloth, by one of 48 points",
    run=run,
    picture="Inflated beams: half of the predicted forces are within {median} %",
    line=lambda curve: curve.partition(", ")[2],
    shown=tuple(f"{size} mm, 50 kPa" for size in (100, 130, 160, 180)),
)
