"""Hand knits pulled along their courses and their wales: the law of the fabric alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.bench import Row
from benchmarks.measured.compared import FITTED, Compared, rows_of, table
from toros_fem.base.errors import FileError
from toros_fem.products.common.options import FitOptions
from toros_fem.products.fitting.fit import fit_material
from toros_fem.products.fitting.samples import FEWEST, TensileTest

NAME = "knits"
ALONE, BOTH = "one direction", "both directions"
DIRECTIONS = ("course", "wale")
# It only makes a modulus of E h, which is what counts.
THICKNESS = 3e-3
# As few draws as are allowed: intervals of the constants are not asked for.
OPTIONS = FitOptions(draws=40)


def test_of(curve: str) -> TensileTest:
    """Return the test of a curve, in N/m."""
    strain, force, lateral = table(NAME)[1][curve].T
    return TensileTest(1 + strain, 1e3 * force, THICKNESS, 1 + lateral,
                       direction=curve.rpartition(", ")[2])  # fmt: skip


def fitted(curves: Sequence[str], kind: str) -> Iterator[Row]:
    """Fit one material to curves of a knit."""
    tests = [test_of(curve) for curve in curves]
    try:
        found = fit_material(tests, OPTIONS)
    except FileError:  # it asks what a force at a strain of 0 is: of the machine, we answer
        found = fit_material(tests, OPTIONS.updated(offset="untared"))
    samples = found.samples
    for number, curve in enumerate(curves):
        own = samples.test == number
        points = np.column_stack([samples.strain, samples.stress / 1e3])[own]
        yield from rows_of(NAME, f"{kind}, {curve}", points, found.stress[own] / 1e3, FITTED)


def run(quick: bool) -> Iterator[Row]:
    """Fit each direction alone, then both at once as a knit with threads in both."""
    known = table(NAME)[1]
    knits = sorted({curve.rpartition(", ")[0] for curve in known})
    for knit in knits[:2] if quick else knits:
        curves = [f"{knit}, {direction}" for direction in DIRECTIONS]
        curves = [curve for curve in curves if len(known[curve]) >= FEWEST]
        for curve in curves:
            yield from fitted([curve], ALONE)
        if len(curves) == len(DIRECTIONS):
            yield from fitted(curves, BOTH)


CASE = Compared(
    name=NAME,
    title="Hand knits",
    known="force and width over the strain, eight knits",
    assumed="one strip, evenly stretched; no hysteresis",
    free="four for one direction, seven for both (all points are fitted)",
    run=run,
    picture="Both directions of a knit are fitted by one law",
    shown=("both directions, rib, acrylic, course", "both directions, rib, acrylic, wale",
           "one direction, rib, acrylic, course", "one direction, rib, acrylic, wale"),
    line=lambda curve: curve.partition(", ")[0],
)  # fmt: skip
