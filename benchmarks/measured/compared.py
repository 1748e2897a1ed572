"""A published measurement beside its simulation.

A row is a measured point: `figure` names its curve, `size` is where on the curve it is, `value` is
simulated and `reference` measured. A row without a reference is a constant that was fitted.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.bench import Row, Rows, timed

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

FOLDER = Path(__file__).parent
# Note of a point by which a constant was chosen: its error is that of a fit.
FITTED = "fitted"
# Name of the row with the number of points and the time of all.
ALL = "points"
# An error is over the measured value, or over this part of the largest one of its curve: near 0
# every error is large.
FLOOR = 0.3


@dataclass(frozen=True)
class Compared:
    """A measurement and what simulates it.

    Attributes:
        name: Of the case, its module and its file of points.
        title: What was measured, the heading of its section.
        known, assumed: What the simulation takes from the source, and what from us.
        free: Constants that are chosen by these measurements; "none" else.
        run: Returns the rows, of a coarse mesh and fewer points if the argument is True.
        picture: What its picture tells, as a sentence with {median} and {worst}.
        shown: Curves of the picture; () takes all.
        axes: What is measured over what; None takes the first columns of the file.
        line: Returns in which line of its table a curve counts.
    """

    name: str
    title: str
    known: str
    assumed: str
    free: str
    run: Callable[[bool], Iterable[Row]]
    picture: str
    shown: tuple[str, ...] = ()
    axes: tuple[str, str] | None = None
    line: Callable[[str], str] = lambda curve: curve

    @property
    def heads(self) -> tuple[str, str]:
        """Return what the axes of its picture are."""
        return self.axes or table(self.name)[0][:2]

    @property
    def anchor(self) -> str:
        """Return the anchor of its section."""
        return self.title.lower().replace(" ", "-")

    def told(self, rows: Rows) -> str:
        """Return what its picture tells, from the committed rows."""
        found, _ = predicted(rows, self.name)
        found = np.abs(found[np.isfinite(found)])
        return self.picture.format(median=f"{np.median(found):.1f}", worst=f"{found.max():.1f}")

    def rows(self, quick: bool) -> Iterator[Row]:
        """Run the case; the last row has the number of points and the wall time."""
        rows, seconds = timed(lambda: list(self.run(quick)))
        yield from rows
        count = sum(row.reference is not None for row in rows)
        yield Row(self.name, "", "", ALL, float(count), seconds=round(seconds, 1))


@cache
def table(name: str) -> tuple[tuple[str, ...], dict[str, Floats]]:
    """Return the heads of the columns of a file, and its points by curve, (n, columns)."""
    with (FOLDER / f"{name}.csv").open(encoding="utf-8") as file:
        head, *lines = csv.reader(line for line in file if not line.startswith("#"))
    curves: dict[str, list[list[float]]] = {}
    for curve, *cells in lines:
        curves.setdefault(curve, []).append([float(cell or "nan") for cell in cells])
    return tuple(head[1:]), {curve: np.array(points) for curve, points in curves.items()}


def rows_of(
    name: str, curve: str, points: Floats, simulated: Sequence[float] | Floats, note: str = "",
    axes: tuple[str, str] | None = None,
) -> list[Row]:  # fmt: skip
    """Return the rows of a curve, from its measured points (n, 2) and the simulated values.

    NaN is a point without an equilibrium.
    """
    along, what = (unit(head) for head in axes or table(name)[0][:2])
    places = zip(points[:, 0], points[:, 1], simulated, strict=True)
    return [
        Row(name, "", f"{at:g} {along}".strip(), curve, value if np.isfinite(value) else None, what,
            float(known), note=note)
        for at, known, value in places
    ]  # fmt: skip


def constant(name: str, what: str, value: float, of: str) -> Row:
    """Return the row of a fitted constant."""
    return Row(name, "", "", what, value, of)


def unit(head: str) -> str:
    """Return the unit of a column's head: N of "force (N)", nothing of "(1)"."""
    return head.partition("(")[2].rstrip(")").removeprefix("1")


def place(row: Row) -> float:
    """Return where on its curve a row is."""
    return float(row.size.split()[0])


def by_curve(rows: Rows, name: str) -> dict[str, list[Row]]:
    """Return the points of a case by curve, in the order of the rows."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        if row.case == name and row.reference is not None:
            found.setdefault(row.figure, []).append(row)
    return found


def errors(curve: Sequence[Row]) -> Floats:
    """Return the errors of a curve's points in per cent, NaN where no equilibrium was found."""
    value, known = np.array([(row.value, row.reference) for row in curve], dtype=float).T
    over = np.maximum(np.abs(known), FLOOR * np.abs(known).max())
    found: Floats = 100 * (value - known) / over
    return found


def predicted(rows: Rows, name: str) -> tuple[Floats, bool]:
    """Return the errors of what was predicted, or of the fit where nothing was; and which."""
    curves = by_curve(rows, name).values()
    free = [curve for curve in curves if curve[0].note != FITTED]
    found = free or list(curves)
    return np.concatenate([errors(curve) for curve in found]), bool(free)


def secant(
    miss: Callable[[float], float], first: float, second: float, within: float,
    reach: float = np.inf, most: int = 9,
) -> float:  # fmt: skip
    """Return where `miss` is 0 to an accuracy, by secants from two places.

    A step is no longer than `reach`.

    Raises:
        ValueError: It is not found in so many steps.
    """
    old, new = (first, miss(first)), (second, miss(second))
    for _ in range(most):
        if abs(new[1]) <= within:
            return new[0]
        step = -new[1] * (new[0] - old[0]) / (new[1] - old[1])
        at = new[0] + float(np.clip(step, -reach, reach))
        old, new = new, (at, miss(at))
    raise ValueError(f"it is {new[1]:.3g} at {new[0]:.6g}, not 0 within {within:.3g}")
