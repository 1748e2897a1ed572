"""One tensile test of a strip, as numbers, and its branches of loading and unloading."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.validation import checked_floats, require_choice, require_positive
from toros_fem.products.options import BRANCHES

# A turn of the stretch smaller than this part of its range is noise.
TURN = 0.15
# Fewest points of a curve.
FEWEST = 5


@dataclass(frozen=True, eq=False)
class TensileTest:
    """A strip pulled in one direction, free to narrow.

    Attributes:
        stretch: Stretch along the pull, (n,), in the order of the test.
        stress: Nominal stress per width in N/m, (n,): force over undeformed width.
        thickness: Thickness in m.
        lateral: Lateral stretch, (n,); None where it was not measured.
        specimen: Name of the specimen.
        direction: Direction of the pull: "course", "wale", or any other name.
        remarks, doubts: What was taken for granted of it, as sentences; doubts move the values.

    Raises:
        ParameterError: The arrays differ in length, are not finite, or have fewer than 5 points; a
            stretch is not positive, or always the same; the lateral stretch grows; all forces are
            0; or the thickness is not positive.
    """

    stretch: Floats
    stress: Floats
    thickness: float
    lateral: Floats | None = None
    specimen: str = "1"
    direction: str = ""
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_positive(thickness=self.thickness)
        stretch = checked_floats(
            "stretch", self.stretch, f"of shape (n,), n at least {FEWEST}",
            lambda shape: len(shape) == 1 and shape[0] >= FEWEST,
        )  # fmt: skip
        object.__setattr__(self, "stretch", stretch)
        object.__setattr__(self, "thickness", float(self.thickness))
        for name in ("stress",) if self.lateral is None else ("stress", "lateral"):
            what = f"of shape {stretch.shape}, as the stretch"
            values = checked_floats(name, getattr(self, name), what, stretch.shape)
            object.__setattr__(self, name, values)
        for fault in self._faults():
            raise ParameterError(fault)

    def _faults(self) -> Iterator[str]:
        """Yield what is wrong with the numbers, as sentences."""
        if not np.any(self.stress):
            yield f"all forces of specimen {self.specimen!r} are 0."
        for kind, one in (("stretch", self.stretch), ("lateral stretch", self.lateral)):
            what = f"the {kind} of specimen {self.specimen!r}"
            if one is not None and not (one.min() > 0 and np.ptp(one) > 0):
                yield (
                    f"{what} is {one.min():.6g} to {one.max():.6g}; it is positive, 1 at rest, and "
                    "not the same at all points."
                )
        if self.lateral is not None and np.cov(self.stretch, self.lateral)[0, 1] > 0:
            yield (
                f"the lateral stretch of specimen {self.specimen!r} grows with the stretch: is its "
                "sign right? A lateral strain is below 0 where the sheet gets narrower."
            )

    @property
    def curve(self) -> Floats:
        """Stretch, stress and lateral stretch, (3, n), which is NaN where it was not measured."""
        lateral = np.full(len(self.stretch), np.nan) if self.lateral is None else self.lateral
        return np.array([self.stretch, self.stress, lateral])

    def taken(self, rows: Ints) -> TensileTest:
        """Return the test with some of its points, by their numbers."""
        lateral = None if self.lateral is None else self.lateral[rows]
        return replace(self, stretch=self.stretch[rows], stress=self.stress[rows], lateral=lateral)

    def begins(self, which: str) -> int:
        """Return the number of branches before one of `BRANCHES`; 0 of all."""
        return 0 if which == "all" else self._ends(which)[2]

    def branch(self, which: str) -> TensileTest:
        """Return the points of one of `BRANCHES` of the load cycles; "all" takes every point.

        Raises:
            FileError: There is no such branch, or it has fewer than 5 points.
        """
        require_choice("branch", which, BRANCHES)
        if which == "all":
            return self
        begin, end, _ = self._ends(which)
        rows = np.arange(begin, end + 1)
        if len(rows) < FEWEST:
            kind = "unloading" if which == "last-unloading" else "loading"
            raise FileError(
                f"specimen {self.specimen!r}: the stretch has no branch of {kind}, or one of "
                f"{len(rows)} points; at least {FEWEST} are needed. Take another branch: "
                f"{', '.join(BRANCHES)}."
            )
        return self.taken(rows)

    def _ends(self, which: str) -> tuple[int, int, int]:
        """Return first and last point of a branch, and its number; no points if it is missing."""
        kind = "unloading" if which == "last-unloading" else "loading"
        found = [
            (begin, end, number)
            for number, (begin, end) in enumerate(_branches(self.stretch))
            if (self.stretch[end] > self.stretch[begin]) == (kind == "loading")
        ]
        return (found or [(0, -1, 0)])[0 if which == "first-loading" else -1]


def _branches(stretch: Floats) -> list[tuple[int, int]]:
    """Return first and last point of each branch, rising or falling.

    A branch ends where the stretch has turned by more than `TURN` of its range.
    """
    least = TURN * float(np.ptp(stretch))
    turns, sign, best = [0], 0.0, 0
    for k, value in enumerate(stretch):
        if sign == 0:
            if abs(value - stretch[0]) > least:
                sign = np.sign(value - stretch[0])
                turns, best = [int(np.argmin(sign * stretch[: k + 1]))], k
        elif sign * (value - stretch[best]) >= 0:
            best = k
        elif sign * (stretch[best] - value) > least:
            turns.append(best)
            sign, best = -sign, k
    return [(begin, end) for begin, end in pairwise([*turns, best]) if end > begin]
