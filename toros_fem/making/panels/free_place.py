"""Free places for texts and arrows beside other things."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats

# Number of places that are tried along the longer side of a region.
TRIED = 48

Size = tuple[float, float]


def rectangles(centres: Floats, size: Size, angle: float | Floats) -> np.ndarray:
    """Return rectangles around points (k, 2), turned by an angle in rad, as polygons."""
    angle = np.broadcast_to(angle, len(centres))
    along = np.column_stack([np.cos(angle), np.sin(angle)]) * size[0] / 2
    aside = np.column_stack([-np.sin(angle), np.cos(angle)]) * size[1] / 2
    corners = [centres + s * along + t * aside for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.asarray(shapely.polygons(np.stack(corners, axis=1)))


def free_place(
    places: Sequence[BaseGeometry], sizes: Sequence[Size], angle: float
) -> tuple[Floats, Size] | None:
    """Return where a rectangle fits into the first region that has room for it, and its size.

    Args:
        places: Regions, the best first, in m.
        sizes: Lengths and widths in m, the best first.
        angle: Direction of the length in rad.

    Returns:
        Centre (2,) and size; None without room anywhere.
    """
    for place in places:
        if place.is_empty:
            continue
        left, low, right, high = place.bounds
        step = max(right - left, high - low) / TRIED
        x, y = np.meshgrid(
            np.arange(left + step / 2, right, step), np.arange(low + step / 2, high, step)
        )
        centres = np.column_stack([x.ravel(), y.ravel()])
        shapely.prepare(place)
        centres = centres[shapely.contains_xy(place, centres)]
        # The nearest to the middle first.
        middle = np.array([left + right, low + high]) / 2
        centres = centres[np.argsort(np.linalg.norm(centres - middle, axis=1), kind="stable")]
        for size in sizes:
            fits = shapely.contains(place, rectangles(centres, size, angle))
            if fits.any():
                return centres[int(np.argmax(fits))], size
    return None
