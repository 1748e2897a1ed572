"""Flat legs and fingers of two panels, those of walkers and grippers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem.base.keys import Count, Factor, key
from toros_fem.base.validation import Floats, Ints
from toros_fem.measures.cross_sections import CrossSections, label_cross_sections, section_vertices
from toros_fem.measures.metrics import Metric, turn_angle
from toros_fem.mechanics.skin.supports import Supports, symmetry_planes
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.common.tables import Orientation

# Cross-sections by which the angle of a leg is measured, and how many are in its outer third.
CROSS_SECTIONS, OUTER_CROSS_SECTIONS = 12, 4
# Part of the reach along a leg that is its tip.
TIP = 0.05


class LegWeights(Orientation):
    """What counts in the objective."""

    cross_sections: Count = key(6, "number of cross-sections of a leg or finger")
    centreline_weight: Factor = key(
        0.02, "weight of the centre line of a leg or finger over that of its orientation"
    )


@dataclass(frozen=True, eq=False)
class Leg:
    """Where a leg or finger lies in the assembled skin, and where it bends to.

    In a star its vertices are those of one leg only if `along` is its direction and `root` is where
    it begins.

    Attributes:
        along, toward: Unit vectors, (3,): along the leg, and the direction that it bends towards.
        root: Where it begins, in m from the origin along `along`.
    """

    along: npt.ArrayLike
    toward: npt.ArrayLike
    root: float

    def labels(self, pattern: Pattern, count: int) -> Ints:
        """Return the cross-section of each vertex, (n,), of so many; −1 before `root`."""
        found = np.flatnonzero(pattern.points @ np.asarray(self.along) > self.root)
        return label_cross_sections(pattern, found, self.along, count, border=False)

    def sections(self, pattern: Pattern, weights: LegWeights) -> CrossSections:
        """Return cross-sections of a pattern whose orientations count, and their positions less."""
        count = weights.cross_sections
        positions = np.full((count, 3), weights.centreline_weight / count)
        orientation = np.full(count, count * (weights.orientation_length / pattern.size) ** 2)
        return CrossSections(self.labels(pattern, count), positions, orientation)

    def angle_metric(
        self, target: float, name: str = "angle", outer_count: int = OUTER_CROSS_SECTIONS
    ) -> Metric:
        """Return the angle in degrees by which the outer part has turned.

        It is the `measures.turn_angle` of all vertices of that part, after the cross-sections that
        come before it. The part, `outer_count` twelfths of the leg, should be one that the target
        leaves straight.
        """

        def measure(pattern: Pattern, positions: Floats) -> float:
            labels, first_outer = self.labels(pattern, CROSS_SECTIONS), CROSS_SECTIONS - outer_count
            outer = np.flatnonzero(labels >= first_outer)
            sections = [*section_vertices(labels)[:first_outer], outer]
            turned = turn_angle(pattern, positions, sections, self.along, self.toward)
            return float(np.degrees(turned))

        return Metric(name, "deg", target, measure)


def tip_positions(pattern: Pattern, positions: Floats, directions: Floats) -> Floats:
    """Return the mean positions of the tips of legs, (k, 3), in m.

    Args:
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        directions: Unit vectors along the legs in the assembled skin, (k, 2).
    """
    reach = pattern.points[:, :2] @ directions.T
    return np.array([positions[r > (1 - TIP) * r.max()].mean(axis=0) for r in reach.T])


def rest_on_body(pattern: Pattern, reach: float, symmetry: Sequence[int] = ()) -> Supports:
    """Fix a flat star, from `two_panels`, at three vertices of its bottom against rigid motion.

    The vertex nearest to the centre is fixed, those nearest to `reach` along +x and +y keep their
    heights, and the first of them keeps its y. A closed skin under pressure exerts no force at
    these six components.

    Args:
        reach: Distance from the centre in m, inside the body.
        symmetry: Axes of the planes that the pattern is cut at. These fix all rigid motion except
            for the height at the centre.
    """
    bottom = pattern.vertices_of("bottom")
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    centre, ahead, aside = (
        bottom[np.argmin(np.linalg.norm(pattern.points[bottom, :2] - point, axis=1))]
        for point in ((0, 0), (reach, 0), (0, reach))
    )
    fixed[centre, 2] = True
    if 0 not in symmetry:
        fixed[centre, 0] = fixed[ahead, 2] = True
    if 1 not in symmetry:
        fixed[centre, 1] = fixed[aside, 2] = True
    if not symmetry:
        fixed[ahead, 1] = True
    return Supports(fixed) | symmetry_planes(pattern, symmetry)
