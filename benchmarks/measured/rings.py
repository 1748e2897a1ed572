"""The membrane that lifts weights, with two stiff rings in it: six published designs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.bench import Row
from benchmarks.measured import compared
from benchmarks.measured.compared import Bools, Compared, Floats
from benchmarks.measured.discs import divided, lifting_pressures, rings
from benchmarks.measured.lifting import RIM
from benchmarks.measured.silicone import silicone
from toros_fem.materials.sheet import Material

NAME = "rings"
# Thickness, radius of the disc, radius and half width of both rings, of each design, in mm.
DESIGNS = {
    "design 1": (2.0, 25.4, 49.0, 5.0, 62.0, 5.0),
    "design 2": (2.33, 29.63, 37.63, 5.0, 62.0, 5.0),
    "design 3": (2.0, 27.98, 45.58, 5.0, 60.29, 6.71),
    "design 4": (2.0, 38.1, 47.55, 6.45, 62.0, 5.0),
    "design 5": (2.0, 25.4, 33.4, 5.0, 46.4, 5.0),
    "design 6": (2.0, 31.92, 46.0, 5.0, 59.0, 5.0),
}
FIRST = "design 1"
POISSON = 0.45


def curves_of(design: str, modulus: float, step: int, *, quick: bool, note: str = "") -> list[Row]:
    """Simulate a design with rings of a modulus in Pa, at heights that are multiples of a step."""
    thickness, disc, *bands = (1e-3 * size for size in DESIGNS[design])
    middles, halves = np.array(bands[::2]), np.array(bands[1::2])
    ends = np.clip([middles - halves, middles + halves], disc, RIM).ravel()
    borders = sorted({disc, RIM, *(float(end) for end in np.round(ends, 5))})
    pattern = rings(divided(borders, 4e-3 if quick else 1.7e-3), 36 if quick else 72)
    composite = silicone(thickness, Material(modulus, POISSON, thickness))

    def stiff(radius: Floats) -> Bools:
        return np.any(np.abs(radius[:, None] - middles) < halves, axis=1)

    found = []
    for curve, points in compared.table(NAME)[1].items():
        if curve.startswith(design):
            chosen = points[points[:, 0] % step == 0]
            weight = float(curve.split()[-2])
            pressures = lifting_pressures(pattern, composite, disc, stiff, weight, chosen)
            found += compared.rows_of(NAME, curve, chosen, pressures, note)
    return found


def run(quick: bool) -> Iterator[Row]:
    """Fit the rings' modulus to the first design, and predict the others."""
    step = 20 if quick else 10

    def miss(power: float) -> float:
        rows = curves_of(FIRST, 10**power, step, quick=quick)
        return float(np.nanmean(compared.errors(rows)))

    modulus = 10 ** compared.secant(miss, 6.0, 6.3, 0.3)
    yield compared.constant(NAME, "modulus of the rings", modulus / 1e6, "MPa")
    yield from curves_of(FIRST, modulus, step, quick=quick, note=compared.FITTED)
    for design in ("design 3",) if quick else list(DESIGNS)[1:]:
        yield from curves_of(design, modulus, step, quick=quick)


CASE = Compared(
    name=NAME,
    title="Rings in the silicone",
    known="sizes of six designs, weights, the silicone's law",
    assumed="rings as thick as the membrane, of Poisson's ratio 0.45; they do not slip or roll",
    free="modulus of the rings, by design 1",
    run=run,
    picture="Rings in the membrane: half of the predicted pressures are within {median} %",
    line=lambda curve: curve.partition(",")[0],
    shown=tuple(f"{design}, 24.5 N" for design in DESIGNS),
)
