"""A clamped silicone membrane with a rigid disc in its middle lifts three weights."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.bench import Row
from benchmarks.measured.compared import Compared, constant, rows_of, table
from benchmarks.measured.discs import divided, lifting_pressures, rings
from benchmarks.measured.silicone import fitted, silicone

NAME = "lifting"
RIM, DISC, THICKNESS = 70e-3, 25.4e-3, 2e-3  # m


def run(quick: bool) -> Iterator[Row]:
    """Find the pressure at each measured height."""
    edge, around = (4.5e-3, 36) if quick else (1.8e-3, 96)
    pattern = rings(divided([DISC, RIM], edge), around)
    yield constant(NAME, "deviation of eq. (1) from the authors' law", fitted()[1], "%")
    for curve, points in table(NAME)[1].items():
        chosen = points[points[:, 0] % 20 == 0] if quick else points
        weight = float(curve.split()[0])
        found = lifting_pressures(pattern, silicone(THICKNESS), DISC, None, weight, chosen)
        yield from rows_of(NAME, curve, chosen, found)


CASE = Compared(
    name=NAME,
    title="Silicone lifts weights",
    known="sizes, weights, the silicone's law (from tensile tests of the authors)",
    assumed="the sheet does not slip on the disc; eq. (1) and a rubber layer stand for the law",
    free="none",
    run=run,
    picture="A silicone membrane lifts weights: half of the pressures are within {median} %",
)
