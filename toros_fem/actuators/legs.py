"""Flat limbs of two panels, the walker's legs and the gripper's fingers: what their demos share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from toros_fem._types import Floats, Ints
from toros_fem.errors import ParameterError
from toros_fem.mechanics.supports import Supports, symmetry_plane
from toros_fem.meshes.pattern import Pattern
from toros_fem.objectives.cross_sections import (
    CrossSections,
    label_cross_sections,
    section_vertices,
)
from toros_fem.objectives.metrics import Metric, turn_angle

# The angle of a limb is that of so much of its length, at the tip.
OUTER = 1 / 3


def limb_vertices(pattern: Pattern, along: npt.ArrayLike, root: float) -> Ints:
    """Vertices that lie further than `root` m along a direction, (3,), in the assembled skin.

    Of a star these are one arm's only if the direction is that arm's and `root` its root.

    Raises:
        ParameterError: There is none.
    """
    found = np.flatnonzero(pattern.points @ np.asarray(along, dtype=np.float64) > root)
    if len(found) == 0:
        raise ParameterError(f"no vertex lies further than root = {root} m along {along!r}.")
    return found


def limb_cross_sections(
    pattern: Pattern,
    along: npt.ArrayLike,
    root: float,
    count: int,
    place: float,
    orientation_length: float,
) -> CrossSections:
    """Sections of a limb whose orientation counts, and less its centre line.

    Args:
        pattern: The pattern.
        along: Unit vector along the limb, (3,).
        root: Where it begins, in m along that.
        count: How many sections.
        place: Weight of the centre line, over that of the orientations.
        lever: Length in m: the tip turned by 0.1 rad counts as if the whole skin were off by a
            tenth of that.
    """
    vertices = limb_vertices(pattern, along, root)
    label = label_cross_sections(pattern, vertices, along, count, border=False)
    turn = np.full(count, count * (orientation_length / pattern.size) ** 2)
    return CrossSections(label, np.full((count, 3), place / count), turn)


def tip_angle_metric(
    asked: float, along: npt.ArrayLike, toward: npt.ArrayLike, root: float, name: str = "angle"
) -> Metric:
    """The angle in degrees by which the outer third of a limb has turned.

    `measure.turn_angle` of all vertices of that third, after the first eight of the limb's twelve
    slabs.

    Args:
        asked: In degrees.
        along, toward: Unit vectors, (3,): of the limb, and to where it bends.
        root: Where it begins, in m along `along`.
        name: What it is called.
    """

    def measure(pattern: Pattern, positions: Floats) -> float:
        vertices = limb_vertices(pattern, along, root)
        label = label_cross_sections(pattern, vertices, along, 12, border=False)
        inner = section_vertices(label)[: round(12 * (1 - OUTER))]
        outer = np.flatnonzero(label >= round(12 * (1 - OUTER)))
        angle = turn_angle(pattern, positions, [*inner, outer], along, toward)
        return float(np.degrees(angle))

    return Metric(name, "deg", asked, measure)


def tips(pattern: Pattern, positions: Floats, directions: Floats, share: float = 0.05) -> Floats:
    """Where the ends of limbs are, (k, 3), in m: the mean of what lies outermost as assembled.

    Args:
        pattern: The pattern.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        directions: Unit vectors along the limbs in the assembled skin, (k, 2).
        share: Of the reach along a limb, counted from its tip.
    """
    far = pattern.points[:, :2] @ directions.T
    return np.array([positions[row > (1 - share) * row.max()].mean(axis=0) for row in far.T])


def rest_on_body(pattern: Pattern, reach: float, symmetry: Sequence[int] = ()) -> Supports:
    """Hold a flat star at three vertices of its bottom, so that only rigid motions are held.

    The one nearest to the centre keeps its place, those nearest to `reach` along +x and +y their
    heights, and the first of them its y: six components, of which a closed skin pulls at none.

    Args:
        pattern: The pattern, from `two_panels`.
        reach: Distance from the centre in m, inside the body.
        symmetry: Axes of the planes that the pattern is cut at: these hold the rest but for the
            height at the centre.
    """
    bottom = pattern.vertices_of("bottom")
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)

    def near(place: tuple[float, float]) -> int:
        away = pattern.points[bottom, :2] - place
        return int(bottom[np.argmin(np.linalg.norm(away, axis=1))])

    fixed[near((0, 0)), 2] = True
    if 0 not in symmetry:
        fixed[near((0, 0)), 0] = fixed[near((reach, 0)), 2] = True
    if 1 not in symmetry:
        fixed[near((0, 0)), 1] = fixed[near((0, reach)), 2] = True
    if not symmetry:
        fixed[near((reach, 0)), 1] = True
    found = Supports(fixed)
    for axis in symmetry:
        found |= symmetry_plane(pattern, axis)
    return found
