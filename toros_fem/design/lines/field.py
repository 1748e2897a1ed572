"""Families of fine parallel lines, given by the share and the direction in each triangle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import real_numbers, require_kind
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True, eq=False)
class LineField:
    """Families of fine parallel lines on a pattern, by triangle; the same on all ranks.

    Attributes:
        pattern: The pattern, with t triangles.
        shares: Part of the area that each of K families covers, shape (t, K), at least 0.
        angles: Direction of each family in rad, from the first axis of the triangle's panel
            chart, counter-clockwise, modulo π, shape (t, K).

    Raises:
        ParameterError: A shape is wrong, a value is not finite, or a share is negative.
    """

    pattern: Pattern
    shares: Floats
    angles: Floats

    def __post_init__(self) -> None:
        require_kind("pattern", self.pattern, Pattern, "a Pattern")
        count = len(self.pattern.panel)
        for name in ("shares", "angles"):
            given = getattr(self, name)
            array = real_numbers(name, given, f"({count}, K), one row for each triangle").copy()
            if array.ndim != 2 or len(array) != count or array.shape[1] == 0:
                raise ParameterError(
                    f"{name} has shape {array.shape}; it must be ({count}, K), a value for each "
                    "triangle and each of K ≥ 1 families."
                )
            if not np.all(np.isfinite(array)):
                row = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
                raise ParameterError(f"{name}[{row}] = {array[row]} is not finite.")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.shares.shape != self.angles.shape:
            raise ParameterError(
                f"shares has {self.shares.shape[1]} families and angles {self.angles.shape[1]}; "
                "they must have the same number."
            )
        if self.shares.min() < 0:
            row = int(np.argmin(self.shares.min(axis=1)))
            raise ParameterError(
                f"shares[{row}] = {self.shares[row]} holds a negative share; the bound is 0."
            )

    @property
    def families(self) -> int:
        """Number K of families."""
        return int(self.shares.shape[1])
