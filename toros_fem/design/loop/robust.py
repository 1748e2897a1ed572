"""Robust designs: eroded and dilated patterns beside the nominal one.

F. Wang, B. S. Lazarov, O. Sigmund: "On projection methods, convergence and robust formulations in
topology optimization", Struct. Multidiscip. Optim. 43, 2011.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.validation import require_positive
from toros_fem.design.density.bar_width import offset_thresholds
from toros_fem.design.density.linear import Filter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.fields import Fields, densities_of
from toros_fem.design.loop.physics import Physics
from toros_fem.measures.shape import Objective

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
    """Eroded and dilated pattern of a design, each with a response of its own.

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
        make: Makes the physics of one more pattern of the same skin.

    Attributes:
        thresholds: η of the eroded and of the dilated pattern.

    Raises:
        ParameterError: The filter's radius is too small or too large for the tolerance.
    """

    def __init__(
        self,
        tolerance: WidthTolerance,
        filter: Filter,
        eta: float,
        make: Callable[[], Physics[Any]],
    ) -> None:
        self.tolerance = tolerance
        self.thresholds = offset_thresholds(filter.name, tolerance.offset / filter.radius, eta)
        self._make = make

    @cached_property
    def physics(self) -> tuple[Physics[Any], ...]:
        """Physics of both patterns (collective where it is made)."""
        return tuple(self._make() for _ in self.thresholds)

    def _projections(self, fields: Fields) -> tuple[Projection, ...]:
        """Return the projections of both patterns, as steep as the nominal one."""
        projection = densities_of(fields).projection
        return tuple(replace(projection, eta=eta) for eta in self.thresholds)

    def patterns(self, fields: Fields, filtered: Floats) -> list[Floats]:
        """Return ρ̄ of both patterns from ρ̃."""
        return [fields.with_passive(step.forward(filtered)) for step in self._projections(fields)]

    def spread(self, objective: Objective, x: Floats, eroded: Floats, dilated: Floats) -> float:
        """Return S from the positions of owned nodes of all three patterns (collective)."""
        h = self._way(eroded, dilated)
        ends = objective.forward(x + h) + objective.forward(x - h)
        return ends / 2 - objective.forward(x)

    def spread_slopes(
        self, objective: Objective, x: Floats, eroded: Floats, dilated: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return ∂S/∂x by the positions of each pattern (collective)."""
        h = self._way(eroded, dilated)
        ahead, behind = objective.backward(x + h), objective.backward(x - h)
        across = (ahead - behind) / 4
        return (ahead + behind) / 2 - objective.backward(x), across, -across

    def pull_back(
        self,
        fields: Fields,
        filtered: Floats,
        variants: Sequence[Any],
        by_variants: Sequence[Floats],
    ) -> tuple[Floats, Floats | float]:
        """Return gradients by ρ̃ and by pressures from those by both shapes (collective)."""
        by_filtered: Floats = np.zeros_like(filtered)
        by_pressure: Floats | float = 0.0
        steps = self._projections(fields)
        for physics, step, response, slope in zip(
            self.physics, steps, variants, by_variants, strict=True
        ):
            by_projected, more = physics.pull_back(response, slope)
            by_filtered += step.backward(filtered, by_projected * fields.designed)
            by_pressure = by_pressure if more is None else by_pressure + more
        return by_filtered, by_pressure

    def figures(self, spread: float, metrics: Sequence[Mapping[str, float]]) -> dict[str, Any]:
        """Return tolerance, spread, thresholds, and the metrics of both patterns."""
        names = ("eroded", "dilated")
        return {
            "width_tolerance_m": self.tolerance.width,
            "border_offset_m": self.tolerance.offset,
            "spread": spread,
            "spread_weight": self.tolerance.weight,
            **{f"eta_{n}": eta for n, eta in zip(names, self.thresholds, strict=True)},
            **{n: dict(found) for n, found in zip(names, metrics, strict=True)},
        }

    def _way(self, eroded: Floats, dilated: Floats) -> Floats:
        """Return h at owned nodes, (n, 3), in m."""
        return np.asarray((eroded - dilated) / 2)
