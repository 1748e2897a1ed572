"""Pads that slide one way, as scales and bristles do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Bools
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_floats, require_positive


@dataclass(frozen=True, eq=False)
class Pads:
    """Pads on a skin that slide easily in one direction along the ground.

    Attributes:
        vertices: Whether each assembled vertex carries a pad, (n,).
        direction: Direction in which they slide easily; its length does not matter. What of it is
            normal to the ground is left out.
        forward: Coefficient of friction in this direction.
        backward: Coefficient against this direction and across it, at least `forward`.
    """

    vertices: Bools
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    forward: float = 0.2
    backward: float = 0.8

    def __post_init__(self) -> None:
        require_positive(forward=self.forward, backward=self.backward)
        if self.forward > self.backward:
            raise ParameterError(
                f"forward = {self.forward:g} must be at most backward = {self.backward:g}: turn "
                "the direction round."
            )
        vertices = np.array(self.vertices)
        if vertices.dtype != bool or vertices.ndim != 1 or not vertices.any():
            raise ParameterError(
                "vertices must be True or False for each assembled vertex, (n,), and True for one "
                "at least."
            )
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        what = "a finite vector of three, other than 0"
        given = checked_floats("direction", self.direction, what, (3,))
        length = float(np.linalg.norm(given))
        if length == 0:
            raise ParameterError(f"direction = {self.direction} must be {what}.")
        object.__setattr__(self, "direction", tuple(float(v) for v in given / length))
