"""Robust designs: eroded and dilated patterns beside the nominal one.

F. Wang, B. S. Lazarov, O. Sigmund: "On projection methods, convergence and robust formulations in
topology optimization", Struct. Multidiscip. Optim. 43, 2011.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.validation import require_positive
from toros_fem.design.density.bar_width import offset_thresholds
from toros_fem.design.density.linear import Filter
from toros_fem.design.density.projection import Projection
from toros_fem.measures.shape import Objective
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver

# Factor on the spread where none is given.
SPREAD_WEIGHT = 100.0


@dataclass(frozen=True)
class WidthTolerance:
    """How far the widths of printed lines may be off, and how much that counts.

    Attributes:
        width: Largest difference of a line's width from the drawn one in m, either way. Each
            border moves by half of it.
        weight: Factor on the spread in the objective. With 1 the objective is the mean of the
            eroded and the dilated pattern; with 100 it is that of ten times the tolerance, as
            shapes change in proportion to widths.

    Raises:
        ParameterError: A value is not positive.
    """

    width: float
    weight: float = SPREAD_WEIGHT

    def __post_init__(self) -> None:
        require_positive(width_tolerance=self.width, spread_weight=self.weight)

    @property
    def offset(self) -> float:
        """Largest way of each border in m."""
        return self.width / 2


class Variants:
    """Eroded and dilated pattern of a design, each with an equilibrium of its own.

    They come from the same filtered density ρ̃ by a higher and a lower threshold of the projection.
    With h, half the difference of both shapes, and x, the nominal shape, their spread is
    S = ½ T(x + h) + ½ T(x − h) − T(x). For a quadratic T this is ½ hᵀ(∂²T/∂x²)h: what the objective
    would be if the target was missed by h.

    Triangles at the border are between fabric and print, and tell its motion roughly. Where the
    difference of shapes of a print is known, what it has beyond that of the design is added to h.

    Args:
        tolerance: How far borders may be off.
        filter: The filter from ρ to ρ̃.
        eta: Threshold of the nominal pattern.
        solver: Makes an equilibrium solver of the same skin.

    Attributes:
        tolerance: As given.
        thresholds: η of the eroded and of the dilated pattern.

    Raises:
        ParameterError: The filter's radius is too small or too large for the tolerance.
    """

    def __init__(
        self,
        tolerance: WidthTolerance,
        filter: Filter,
        eta: float,
        solver: Callable[[], EquilibriumSolver],
    ) -> None:
        self.tolerance = tolerance
        self.thresholds = offset_thresholds(filter.name, tolerance.offset / filter.radius, eta)
        self._solver = solver
        self._missing: Floats | float = 0.0

    @cached_property
    def solvers(self) -> tuple[EquilibriumSolver, ...]:
        """Solvers of both patterns (collective where they are made)."""
        return tuple(self._solver() for _ in self.thresholds)

    def corrected(self, printed: Floats, both: Sequence[Equilibrium]) -> Self:
        """Return the same patterns with the difference of shapes of a print; solvers are shared.

        Args:
            printed: Half the way from the print with wider lines to that with narrower ones, at
                owned nodes, (n, 3), in m.
            both: Equilibria of the eroded and the dilated pattern of that design.
        """
        _ = self.solvers
        other = copy.copy(self)
        other._missing = printed - _half_difference(both)
        return other

    def projections(self, nominal: Projection) -> tuple[Projection, ...]:
        """Return the projections of both patterns, as steep as the nominal one."""
        return tuple(Projection(nominal.beta, eta) for eta in self.thresholds)

    def spread(
        self, objective: Objective, nominal: Equilibrium, both: Sequence[Equilibrium]
    ) -> float:
        """Return S (collective).

        Args:
            objective: T as a function of positions.
            nominal: Equilibrium of the nominal pattern.
            both: Those of the eroded and of the dilated pattern.
        """
        x, h = nominal.positions, self._way(both)
        ends = objective.forward(x + h) + objective.forward(x - h)
        return ends / 2 - objective.forward(x)

    def spread_slopes(
        self, objective: Objective, nominal: Equilibrium, both: Sequence[Equilibrium]
    ) -> tuple[Floats, Floats, Floats]:
        """Return ∂S/∂x by the positions of the nominal, eroded, dilated pattern (collective)."""
        x, h = nominal.positions, self._way(both)
        ahead, behind = objective.backward(x + h), objective.backward(x - h)
        across = (ahead - behind) / 4
        return (ahead + behind) / 2 - objective.backward(x), across, -across

    def _way(self, both: Sequence[Equilibrium]) -> Floats:
        """Return h at owned nodes, (n, 3), in m."""
        return np.asarray(_half_difference(both) + self._missing)


def _half_difference(both: Sequence[Equilibrium]) -> Floats:
    """Return half the way from the second shape to the first at owned nodes, (n, 3), in m."""
    one, two = both
    return np.asarray((one.positions - two.positions) / 2)
