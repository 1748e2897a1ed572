"""The benchmark `measured`: published measurements beside their simulation.

    python -m benchmarks measured --workers 2 --rows output/measured.csv
    python -m benchmarks measured --rows output/measured.csv --page

An error is over the measured value, or over 30 % of the largest one of its curve where that is
more. Points by which a constant was chosen do not count as predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.bench import Case, Command, Row, Rows, Table, markdown
from benchmarks.measured import (
    beam,
    bulge,
    channel,
    fibre_tube,
    knits,
    lifting,
    offset_print,
    rings,
)
from benchmarks.measured.compared import ALL, FITTED, Compared, Floats, by_curve, errors, predicted

COMPARED: Sequence[Compared] = tuple(
    module.CASE
    for module in (lifting, rings, bulge, beam, fibre_tube, knits, channel, offset_print)
)


def cases(quick: bool) -> list[Case]:
    """Return all cases, of coarse meshes if the argument is True."""
    return [Case(one.name, partial(one.rows, quick)) for one in COMPARED]


def summary(rows: Rows) -> str:
    """Return a line for each case: what is known, assumed, free, and the errors."""
    lines = []
    for one in COMPARED:
        found, free = predicted(rows, one.name)
        (whole,) = (row for row in rows if (row.case, row.figure) == (one.name, ALL))
        lines.append((
            f"[{one.title}](#{one.anchor})", one.known, one.assumed, one.free,
            f"{len(found)}{'' if free else ' (fit)'}", *middle_and_worst(found),
            f"{whole.seconds:.0f} s",
        ))  # fmt: skip
    head = ("case", "known", "assumed", "free constants", "points", "median", "worst", "time")
    return markdown(head, lines)


def middle_and_worst(found: Floats) -> tuple[str, str]:
    """Return the median of the absolute error, and the largest error with its sign."""
    seen = found[np.isfinite(found)]
    return f"{np.median(np.abs(seen)):.1f} %", f"{seen[np.argmax(np.abs(seen))]:+.1f} %"


def lines_of(compared: Compared, rows: Rows) -> str:
    """Return the errors of a case by line of its table, and its constants."""
    groups: dict[str, list[list[Row]]] = {}
    for curve, points in by_curve(rows, compared.name).items():
        groups.setdefault(compared.line(curve), []).append(points)
    lines = []
    for line, curves in groups.items():
        found = np.concatenate([errors(curve) for curve in curves])
        seen = found[np.isfinite(found)]
        lost = len(found) - len(seen)
        note = " (fitted)" if curves[0][0].note == FITTED else ""
        middle, worst = middle_and_worst(found)
        lines.append((
            f"{line}{note}", f"{len(found)}{f', {lost} without equilibrium' * bool(lost)}",
            f"{seen.mean():+.1f} %", f"{np.sqrt((seen**2).mean()):.1f} %", middle, worst,
        ))  # fmt: skip
    table = markdown(("curve", "points", "mean", "rms", "median", "worst"), lines)
    constants = [
        f"{row.figure[0].upper()}{row.figure[1:]}: {row.value:.3g} {row.unit}."
        for row in rows
        if row.case == compared.name and row.reference is None and row.figure != ALL
    ]
    return "\n\n".join([*constants, table])


COMMAND = Command(
    about=__doc__,
    cases=cases,
    bad=lambda row: row.reference is not None and row.value is None,
    serial=True,
    tables=(
        Table("validation.md", "measured, summary", summary),
        *(
            Table("validation.md", f"measured, {one.name}", partial(lines_of, one))
            for one in COMPARED
        ),
    ),
)
