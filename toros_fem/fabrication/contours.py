"""Outlines of panels and of the reinforcement, as polygons on the flat panels."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Floats, Ints
from toros_fem.errors import DensityError
from toros_fem.meshes.pattern import Pattern

# A contour that passes a vertex closer than this share of an edge is led through the vertex:
# otherwise there would be polygons whose corners rounding merges.
SNAP = 1e-9


def panel_outline(pattern: Pattern, panel: int) -> BaseGeometry:
    """The cloth of a panel as a polygon, in m."""
    corners = pattern.corners[pattern.panel == panel]
    return shapely.coverage_union_all(shapely.polygons(corners))


def printed_regions(
    pattern: Pattern, at_points: Floats, at_centroids: Floats, threshold: float
) -> list[BaseGeometry]:
    """The reinforced region of every panel; arguments as of `reinforcement`."""
    return [
        reinforcement(pattern, at_points, at_centroids, panel, threshold)
        for panel in range(len(pattern.panel_names))
    ]


def reinforcement(
    pattern: Pattern, at_points: Floats, at_centroids: Floats, panel: int, threshold: float
) -> BaseGeometry:
    """Where a panel is reinforced: the region density > threshold, in m.

    Each triangle is split in three at its centroid and the density is linear on every third, so
    that both given values are met exactly.

    Args:
        pattern: The pattern.
        at_points: Filtered density ρ̃ at the pattern's flat points, (m,).
        at_centroids: ρ̃ at the triangles' centroids, (t,).
        panel: Number of the panel.
        threshold: η. The contour of ρ̃ at η is the design's.

    Raises:
        DensityError: The values do not fit the pattern, or are not finite.
    """
    count = len(pattern.flat_points)
    for name, array, size in (
        ("at_points", at_points, count),
        ("at_centroids", at_centroids, len(pattern.panel)),
    ):
        if np.shape(array) != (size,) or not np.all(np.isfinite(array)):
            raise DensityError(f"{name} must hold {size} finite values, one for each.")
    cells = np.flatnonzero(pattern.panel == panel)
    points = np.concatenate([pattern.flat_points, pattern.centroids])
    value = np.concatenate([at_points, at_centroids]) - threshold
    value[np.abs(value) < SNAP] = 0
    corner, centre = pattern.flat_triangles[cells], (count + cells)[:, None]
    whole = np.all(value[corner] > 0, axis=1) & (value[centre[:, 0]] > 0)
    thirds = np.stack([corner, np.roll(corner, -1, axis=1), np.repeat(centre, 3, axis=1)], axis=2)
    third = thirds[~whole].reshape(-1, 3)
    inside = value[third] > 0
    below = np.any(value[third] < 0, axis=1)
    pieces = [
        points[corner[whole]],
        points[third[inside.any(axis=1) & ~below]],
        *_cut(points, value, third[inside.any(axis=1) & below]),
    ]
    polygons = np.concatenate(
        [shapely.polygons(p) for p in pieces if len(p)] or [np.empty(0, object)]
    )
    return shapely.coverage_union_all(polygons)


def _cut(points: Floats, value: Floats, triangles: Ints) -> tuple[Floats, Floats]:
    """Positive parts of triangles with values of both signs: triangles and quadrilaterals."""
    inside = value[triangles] > 0
    lone = inside.sum(axis=1) == 1
    apart = np.argmax(inside == lone[:, None], axis=1)  # the corner on a side of its own
    order = (apart[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, order, axis=1).T
    ab, ac = _crossing(points, value, a, b), _crossing(points, value, a, c)
    tips = np.stack([points[a], ab, ac], axis=1)[lone]
    return tips, np.stack([ab, points[b], points[c], ac], axis=1)[~lone]


def _crossing(points: Floats, value: Floats, a: Ints, b: Ints) -> Floats:
    """Where edges cross 0, rounded alike from both sides, and at the vertex itself if it is 0."""
    outer, inner = np.where(value[a] > 0, [b, a], [a, b])
    share = value[outer] / (value[outer] - value[inner])
    return points[outer] + share[:, None] * (points[inner] - points[outer])


def layout(pattern: Pattern, gap: float) -> list[Floats]:
    """Offset (2,) of each panel in m that puts all panels in one row, without overlap."""
    offsets, right = [], 0.0
    for panel in range(len(pattern.panel_names)):
        corners = pattern.corners[pattern.panel == panel].reshape(-1, 2)
        low, high = corners.min(axis=0), corners.max(axis=0)
        offsets.append(np.array([right - low[0], -low[1]]))
        right += high[0] - low[0] + gap
    return offsets
