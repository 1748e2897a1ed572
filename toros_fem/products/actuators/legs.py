"""Flat legs and fingers of two panels, those of walkers and grippers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import require_between
from toros_fem.measures.cross_sections import CrossSections, label_cross_sections, section_vertices
from toros_fem.measures.metrics import Metric, turn_angle
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes.pattern import Pattern

# Cross-sections by which the angle of a leg is measured, and how many are in its outer third.
CROSS_SECTIONS, OUTER_CROSS_SECTIONS = 12, 4


def leg_vertices(pattern: Pattern, along: npt.ArrayLike, root: float) -> Ints:
    """Return the vertices that lie beyond `root` along a direction in the assembled skin.

    In a star these belong to one leg only if `along` is its direction and `root` is where it
    begins.

    Args:
        pattern: The pattern.
        along: Unit vector, (3,).
        root: Distance from the origin along it, in m.

    Raises:
        ParameterError: There is none.
    """
    found = np.flatnonzero(pattern.points @ np.asarray(along, dtype=np.float64) > root)
    if len(found) == 0:
        raise ParameterError(
            f"no vertex lies beyond root = {root} m along {along!r}. Give a smaller root, or "
            "another direction."
        )
    return found


def leg_cross_sections(
    pattern: Pattern,
    along: npt.ArrayLike,
    root: float,
    count: int,
    centreline_weight: float,
    orientation_length: float,
) -> CrossSections:
    """Return cross-sections of a leg or finger: their orientations count, positions less.

    Args:
        pattern: The pattern.
        along: Unit vector along the leg, (3,).
        root: Where it begins, in m along that.
        count: Number of cross-sections.
        centreline_weight: Weight of the centre line over that of the orientations.
        orientation_length: A tip turned by 0.1 rad costs as much as a skin displaced by a tenth of
            this length, in m.
    """
    vertices = leg_vertices(pattern, along, root)
    labels = label_cross_sections(pattern, vertices, along, count, border=False)
    orientation = np.full(count, count * (orientation_length / pattern.size) ** 2)
    return CrossSections(labels, np.full((count, 3), centreline_weight / count), orientation)


def tip_angle_metric(
    target: float,
    along: npt.ArrayLike,
    toward: npt.ArrayLike,
    root: float,
    name: str = "angle",
    outer_count: int = OUTER_CROSS_SECTIONS,
) -> Metric:
    """Return the angle in degrees by which the outer part of a leg or finger has turned.

    It is the `measures.turn_angle` of all vertices of that part, after the cross-sections that
    come before it. The part should be one that the target leaves straight.

    Args:
        target: Target angle in degrees.
        along, toward: Unit vectors, (3,): along the leg, and the direction that it bends towards.
        root: Where the leg begins, in m along `along`.
        name: Name of the metric.
        outer_count: Number of twelfths of the leg that the outer part has.

    Raises:
        ParameterError: The outer part is not 1 to 11 twelfths of the leg.
    """
    require_between(1, CROSS_SECTIONS - 1, outer_count=outer_count)

    def measure(pattern: Pattern, positions: Floats) -> float:
        vertices = leg_vertices(pattern, along, root)
        labels = label_cross_sections(pattern, vertices, along, CROSS_SECTIONS, border=False)
        first_outer = CROSS_SECTIONS - outer_count
        inner = section_vertices(labels)[:first_outer]
        outer = np.flatnonzero(labels >= first_outer)
        return float(np.degrees(turn_angle(pattern, positions, [*inner, outer], along, toward)))

    return Metric(name, "deg", target, measure)


def tip_positions(
    pattern: Pattern, positions: Floats, directions: Floats, fraction: float = 0.05
) -> Floats:
    """Return the mean positions of the tips of legs, (k, 3), in m.

    Args:
        pattern: The pattern.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        directions: Unit vectors along the legs in the assembled skin, (k, 2).
        fraction: Fraction of the reach along a leg that counts as its tip.
    """
    reach = pattern.points[:, :2] @ directions.T
    return np.array([positions[r > (1 - fraction) * r.max()].mean(axis=0) for r in reach.T])


def rest_on_body(pattern: Pattern, reach: float, symmetry: Sequence[int] = ()) -> Supports:
    """Fix a flat star at three vertices of its bottom against rigid motion only.

    The vertex nearest to the centre is fixed, those nearest to `reach` along +x and +y keep their
    heights, and the first of them keeps its y. A closed skin under pressure exerts no force at
    these six components.

    Args:
        pattern: The pattern, from `two_panels`.
        reach: Distance from the centre in m, inside the body.
        symmetry: Axes of the planes that the pattern is cut at. These fix all rigid motion except
            for the height at the centre.
    """
    bottom = pattern.vertices_of("bottom")
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)

    def nearest(point: tuple[float, float]) -> int:
        distance = np.linalg.norm(pattern.points[bottom, :2] - point, axis=1)
        return int(bottom[np.argmin(distance)])

    fixed[nearest((0, 0)), 2] = True
    if 0 not in symmetry:
        fixed[nearest((0, 0)), 0] = fixed[nearest((reach, 0)), 2] = True
    if 1 not in symmetry:
        fixed[nearest((0, 0)), 1] = fixed[nearest((0, reach)), 2] = True
    if not symmetry:
        fixed[nearest((reach, 0)), 1] = True
    found = Supports(fixed)
    for axis in symmetry:
        found |= symmetry_plane(pattern, axis)
    return found
