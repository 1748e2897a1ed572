"""Tables of what acts on a skin, of what counts, and of what is simulated of a print."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from toros_fem.base.array_types import Ints
from toros_fem.base.keys import (
    Count,
    Distance,
    Factor,
    Flag,
    Fraction,
    In,
    Length,
    Modulus,
    Positive,
    Pressure,
    Table,
    key,
)
from toros_fem.measures.cross_sections import CrossSections
from toros_fem.measures.figures import DEFAULT, Tolerances
from toros_fem.measures.shape import ShapePart
from toros_fem.meshes.pattern import Pattern


class PressureTable(Table):
    """Pressure."""

    pressure: Pressure = key(
        10e3, "most that the pump gives: a design takes what its target wants, a simulation all"
    )
    hold_pressure: Flag = key(
        False, "design for exactly this pressure, and not for the least that the target wants"
    )


class ContactTable(Table):
    """Contact and friction."""

    friction: Positive | None = key(
        None, "coefficient of Coulomb's friction on ground and bodies; none for none"
    )
    contact_distance: Length | None = key(
        None,
        "distance of two faces from which on contact acts; none takes half of the fabric's "
        "thickness",
    )


class Orientation(Table):
    """What counts in the objective."""

    orientation_length: Distance = key(
        0.03, "a tip turned by 0.1 rad costs as much as a skin displaced by a tenth of this length"
    )


class TipWeights(Orientation):
    """What counts in the objective."""

    tip_weight: Factor = key(1.0, "weight of the tip's position over that of all the rest")

    def shape_part(self, pattern: Pattern, tip: Ints, turned: Ints, radius: float) -> ShapePart:
        """Return the shape of a whole pattern that counts, and its tip more.

        Args:
            tip: Vertices of the tip.
            turned: Vertices whose orientation counts.
            radius: Of these in m: turned by a small angle about a diameter they move by
                angle · radius/√2 in root mean square.
        """
        area, weights = pattern.vertex_areas, np.ones(len(pattern.points))
        weights[tip] += self.tip_weight * area.sum() / area[tip].sum()
        relative = np.zeros(len(pattern.points))
        ratio = np.sqrt(2) * self.orientation_length / radius
        relative[turned] = ratio**2 * (area @ weights) / area[turned].sum()
        return ShapePart(weights, relative)


class SectionWeights(TipWeights):
    """What counts in the objective."""

    cross_sections: Count = key(12, "number of cross-sections along the wall; the tip is one more")
    axial_weight: Factor = key(
        1.0, "weight of the cross-sections' positions along the axis over that across"
    )

    def sections_part(
        self, pattern: Pattern, labels: Ints, axis: int, *, border: bool = True
    ) -> CrossSections:
        """Return cross-sections of a whole pattern that count.

        If each of n sections is off by δ/n from the one before, the tip is off by δ.

        Args:
            labels: Cross-section of each vertex, as of `label_cross_sections`.
            axis: Axis of the body, 0 for x, …
            border: Whether the tip is one section more than `cross_sections`.
        """
        share = 1 / self.cross_sections
        last = self.tip_weight if border else max(share, self.tip_weight)
        fraction = np.append(np.full(self.cross_sections - (not border), share), last)
        components = np.where(np.arange(3) == axis, self.axial_weight, 1.0)
        ratio = self.orientation_length / pattern.size
        orientation = np.full(len(fraction), len(fraction) * last * ratio**2)
        return CrossSections(labels, np.outer(fraction, components), orientation)


class ResultTable(Table):
    """What is simulated of the print, and what counts as reached."""

    estimate_error: Flag = key(
        True,
        "estimate the discretisation error of the metrics, from other meshes",
        free=True,
    )
    check_refinement: Annotated[float, In(at_least=1.2, at_most=8)] | None = key(
        None,
        "edge length over that of a finer mesh, on which the print is simulated once more: its "
        "values are told, and lines are corrected by them (of an own mesh the nearest power of 2); "
        "none leaves it out",
        free=True,
    )
    curve_pressure: Modulus | None = key(
        20e3,
        "largest pressure up to which the metrics of the print are followed; none leaves this "
        "curve out",
        free=True,
    )
    curve_steps: Count = key(
        10, "number of equal steps of the curve from 0 to that pressure", free=True
    )
    tolerance: Fraction = key(
        DEFAULT.figure,
        "part of its target that a figure may be off by and count as reached",
        free=True,
    )
    shape_tolerance: Fraction = key(
        DEFAULT.shape,
        "part of the skin's length that a shape may be off by, as root mean square, and count as "
        "reached",
        free=True,
    )
    direction_tolerance: Annotated[float, In("deg", above=0, at_most=180)] = key(
        DEFAULT.direction,
        "angle that the direction of a tip may be off by and count as reached",
        free=True,
    )

    @property
    def tolerances(self) -> Tolerances:
        """What counts as reached."""
        return Tolerances(self.tolerance, self.shape_tolerance, self.direction_tolerance)
