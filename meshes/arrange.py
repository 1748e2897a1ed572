"""Places of flat panels beside each other: turned upright, and packed in rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from toros_fem._types import Floats
from toros_fem.meshes.pattern import Pattern

# Gap between panels as a fraction of the side of a square of their whole area.
GAP = 0.04
# Panels whose bounding boxes are closer than this fraction of the drawing's size touch.
TOUCHING = 1e-6


def arranged(panels: Sequence[Floats]) -> list[Floats]:
    """Turn panels so that their narrowest rectangle is upright, and pack them in rows.

    Args:
        panels: Flat points (m, 2) of each panel, in m.

    Returns:
        The same panels, rotated and translated into the first quadrant. No two overlap.
    """
    upright = [_upright(points) for points in panels]
    sizes = np.array([points.max(axis=0) for points in upright])
    side = float(np.sqrt(sizes.prod(axis=1).sum()))
    corners = _in_rows(sizes, 1.3 * side, GAP * side)
    return [points + corner for points, corner in zip(upright, corners, strict=True)]


def panel_offsets(pattern: Pattern, gap: float) -> list[Floats]:
    """Return the translation of each panel to its place on a drawing of the whole pattern.

    Panels that are apart in the flat plane, as those of `unwrap`, keep their places: all offsets
    are equal. Panels that overlap or touch, as those of `cylinder`, are packed in rows.

    Args:
        pattern: The pattern.
        gap: Gap between panels that are packed here, in m.

    Returns:
        The offset (2,) in m of each panel. The drawing's lower left corner is the origin.
    """
    corners = [
        pattern.corners[pattern.panel == panel].reshape(-1, 2)
        for panel in range(len(pattern.panel_names))
    ]
    low = np.array([points.min(axis=0) for points in corners])
    high = np.array([points.max(axis=0) for points in corners])
    if _apart(low, high):
        return [-low.min(axis=0)] * len(low)
    sizes = high - low
    side = float(np.sqrt(sizes.prod(axis=1).sum()))
    return list(_in_rows(sizes, 2.5 * side, gap) - low)


def _apart(low: Floats, high: Floats) -> bool:
    """Return whether no two boxes, given by their corners (p, 2), overlap or touch."""
    near = TOUCHING * float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    gaps = np.maximum(low[:, None] - high, low - high[:, None]).max(axis=2)
    return bool(np.all(gaps[np.triu_indices(len(low), 1)] > near))


def _in_rows(sizes: Floats, width: float, gap: float) -> Floats:
    """Return the lower left corner of each rectangle, (p, 2), in rows of about this width."""
    width = max(width, float(sizes[:, 0].max()))
    corners = np.zeros_like(sizes)
    corner, height = np.zeros(2), 0.0
    for k in np.argsort(-sizes[:, 1].round(9), kind="stable"):  # the tallest first
        size = sizes[k]
        if corner[0] > 0 and corner[0] + size[0] > width:
            corner, height = np.array([0.0, corner[1] + height + gap]), 0.0
        corners[k] = corner
        corner = corner + [size[0] + gap, 0]
        height = max(height, float(size[1]))
    return corners


def _upright(points: Floats) -> Floats:
    frame = shapely.oriented_envelope(shapely.MultiPoint(points))
    corners = shapely.get_coordinates(frame)
    sides = np.diff(corners[:3], axis=0)
    long = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    turn = np.exp(1j * (np.pi / 2 - np.arctan2(long[1], long[0])))
    place = (points @ [1, 1j]) * turn
    turned = np.column_stack([place.real, place.imag])
    return turned - turned.min(axis=0)
