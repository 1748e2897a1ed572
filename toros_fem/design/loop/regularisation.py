"""What makes a design of densities printable: filter, projection, widths, perimeter."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from toros_fem.design.density.length_scale import LengthScale
from toros_fem.design.density.neighbours import require_radius
from toros_fem.design.density.perimeter import SHARPNESS
from toros_fem.design.density.projection import Projection

# Power q of the projection: with 2 bends need less print than with 1, and are nearer to their
# targets (docs/theory/design.md).
POWER = 2.0


@dataclass(frozen=True)
class Regularisation:
    """Filter, projection, widths and perimeter of a design of densities.

    Only what is given is built: no perimeter without a weight. `ShapeDesign` checks the values.

    Attributes:
        filter_radius: R of the density filter in m.
        filter: "cone" or "helmholtz".
        projection: Smoothed step from ρ̃ to ρ̄, by default that of the paper with the power 2.
        length_scale: Widths of lines and gaps that constrained stages enforce; None leaves the
            constraints out.
        perimeter_weight: Weight of the perimeter term; None leaves it out.
        perimeter_window: Radius of its window in m; None takes R.
        perimeter_sharpness: w of eq. (15), as of `Perimeter`.
    """

    filter_radius: float
    filter: str = "cone"
    projection: Projection = field(default_factory=lambda: Projection(power=POWER))
    length_scale: LengthScale | None = field(default_factory=LengthScale)
    perimeter_weight: float | None = None
    perimeter_window: float | None = None
    perimeter_sharpness: float = SHARPNESS

    def require_possible(self, size: float) -> None:
        """Check what is known without a mesh, on a skin of a size in m.

        Raises:
            ParameterError: The filter is larger than the skin, or cannot enforce widths.
        """
        require_radius(self.filter_radius, size)
        if self.length_scale is not None:
            self.length_scale.thresholds(self.filter, self.filter_radius, self.projection.eta)

    @property
    def plain(self) -> Regularisation:
        """Filter and projection alone, for a mesh on which nothing is designed."""
        return replace(self, length_scale=None, perimeter_weight=None)

    def scaled(self, factor: float) -> Regularisation:
        """Return the same on a mesh whose edges are longer by a factor: all lengths follow it."""
        widths, window = self.length_scale, self.perimeter_window
        return replace(
            self,
            filter_radius=factor * self.filter_radius,
            length_scale=None if widths is None else widths.scaled(factor),
            perimeter_window=None if window is None else factor * window,
        )
