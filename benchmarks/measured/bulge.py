"""A clamped round sheet of coated polyester bulges under pressure: four samples of one fabric."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from mpi4py import MPI
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar

from benchmarks.bench import Row
from benchmarks.measured.compared import FITTED, Compared, Floats, constant, rows_of, table
from benchmarks.measured.skins import Held, border
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes.sheets import disc

NAME = "bulge"
RADIUS, THICKNESS, POISSON = 0.1, 0.81e-3, 0.24  # m
# The height depends on the pressure over the modulus alone: one curve serves all moduli.
MODULUS = 250e6
PRESSURES = np.geomspace(5e3, 500e3, 15)  # Pa
# Below it slack and the zero of the measurement count; kPa.
LEAST = 50.0


def heights(quick: bool) -> Callable[[Floats], Floats]:
    """Return the height in mm by the pressure in kPa over the modulus in MPa."""
    edge = RADIUS / (10 if quick else 20)

    def raised(flat: Floats) -> Floats:
        return np.column_stack([flat, 1e-3 * (1 - (flat**2).sum(axis=1) / RADIUS**2)])

    pattern = disc(MPI.COMM_SELF, RADIUS, edge, "structured", raised)
    sheet = Material(MODULUS, POISSON, THICKNESS)
    # Bounds so far away that the sheet is linear.
    composite = Composite(fabric=sheet, reinforcement=sheet, c1=9.0, c2=17.0, bending=None)
    # The sheet is so much stiffer than its load that rounding leaves the residual fewer digits.
    skin = Held(pattern, composite, border(pattern), options=NewtonOptions(tolerance=1e-5))
    found = [1e3 * skin.under(Load(pressure))[0][:, 2].max() for pressure in PRESSURES]
    curve = PchipInterpolator(np.log(1e3 * PRESSURES / MODULUS), np.log(found))
    return lambda ratio: np.exp(curve(np.log(ratio)))


def run(quick: bool) -> Iterator[Row]:
    """Fit the modulus to what test 1 rises above 50 kPa, and predict the other tests."""
    height = heights(quick)
    tests = {name: points[points[:, 0] > LEAST] for name, points in table(NAME)[1].items()}

    def rises(points: Floats, modulus: float) -> tuple[Floats, Floats]:
        simulated = height(points[:, 0] / modulus)
        known = np.column_stack([points[1:, 0], points[1:, 1] - points[0, 1]])
        return known, simulated[1:] - simulated[0]

    def squares(modulus: float) -> float:
        known, simulated = rises(tests["test 1"], modulus)
        return float(((known[:, 1] - simulated) ** 2).sum())

    modulus = float(minimize_scalar(squares, bounds=(140.0, 400.0), method="bounded").x)
    yield constant(NAME, "modulus of the fabric", modulus, "MPa")
    for name, points in tests.items():
        note = FITTED if name == "test 1" else ""
        yield from rows_of(NAME, f"{name}, rise", *rises(points, modulus), note)
    for name, points in tests.items():
        last = points[-1:]
        yield from rows_of(NAME, f"{name}, height", last, height(last[:, 0] / modulus))


CASE = Compared(
    name=NAME,
    title="Coated fabric bulges",
    known="sizes, pressures; four samples of one fabric",
    assumed="Poisson's ratio 0.24; a linear sheet, equally stiff in all directions",
    free="modulus of the fabric, by test 1",
    run=run,
    picture="Coated fabric bulges: half of the predicted heights are within {median} %",
    shown=tuple(f"test {number}, rise" for number in range(1, 5)),
)
