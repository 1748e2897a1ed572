"""Flat panels turned upright and laid out in rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from toros_fem._types import Floats

# Gap between panels as a share of the side of a square of their whole area.
GAP = 0.04


def arranged(panels: Sequence[Floats]) -> list[Floats]:
    """Panels turned so that their narrowest rectangle lies upright, in rows without overlap.

    Args:
        panels: Flat points (m, 2) of each panel, in m.

    Returns:
        The same, moved by rotations and translations, in the first quadrant.
    """
    upright = [_upright(points) for points in panels]
    sizes = np.array([points.max(axis=0) for points in upright])
    side = float(np.sqrt(sizes.prod(axis=1).sum()))
    width = max(1.3 * side, float(sizes[:, 0].max()))
    placed = list(upright)
    corner, height = np.zeros(2), 0.0
    for k in np.argsort(-sizes[:, 1].round(9), kind="stable"):  # the tallest first
        size = sizes[k]
        if corner[0] > 0 and corner[0] + size[0] > width:
            corner, height = np.array([0.0, corner[1] + height + GAP * side]), 0.0
        placed[k] = upright[k] + corner
        corner = corner + [size[0] + GAP * side, 0]
        height = max(height, float(size[1]))
    return placed


def _upright(points: Floats) -> Floats:
    frame = shapely.oriented_envelope(shapely.MultiPoint(points))
    corners = shapely.get_coordinates(frame)
    sides = np.diff(corners[:3], axis=0)
    long = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    turn = np.exp(1j * (np.pi / 2 - np.arctan2(long[1], long[0])))
    place = (points @ [1, 1j]) * turn
    turned = np.column_stack([place.real, place.imag])
    return turned - turned.min(axis=0)
