"""Free places for texts, arrows and rulers beside other things."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats

# Number of places that are tried along the longer side of a region.
TRIED = 48

# Length and width in m.
Size = tuple[float, float]


def rectangles(centres: Floats, size: Size, angle: float | Floats) -> np.ndarray:
    """Return rectangles around points (k, 2), turned by an angle in rad, as polygons."""
    angle = np.broadcast_to(angle, len(centres))
    along = np.column_stack([np.cos(angle), np.sin(angle)]) * size[0] / 2
    aside = np.column_stack([-np.sin(angle), np.cos(angle)]) * size[1] / 2
    corners = [centres + s * along + t * aside for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.asarray(shapely.polygons(np.stack(corners, axis=1)))


def first_fit(
    region: BaseGeometry, centres: Floats, angles: float | Floats, sizes: Iterable[Size]
) -> tuple[int, Size] | None:
    """Return the first place where the first rectangle lies in a region that fits anywhere.

    Places (k, 2) and sizes are tried the best first, at an angle in rad of the length, or one for
    each place. Returned are the number of the place, and the size; None without room.
    """
    shapely.prepare(region)
    for size in sizes:
        fits = shapely.contains(region, rectangles(centres, size, angles))
        if fits.any():
            return int(np.argmax(fits)), size
    return None


def places_in(region: BaseGeometry) -> Floats:
    """Return places in a region, (k, 2), the nearest to its middle first."""
    if region.is_empty:
        return np.empty((0, 2))
    left, low, right, high = region.bounds
    step = max(right - left, high - low) / TRIED
    x, y = np.meshgrid(
        np.arange(left + step / 2, right, step), np.arange(low + step / 2, high, step)
    )
    places = np.column_stack([x.ravel(), y.ravel()])
    shapely.prepare(region)
    places = places[shapely.contains_xy(region, places)]
    far = np.linalg.norm(places - np.array([left + right, low + high]) / 2, axis=1)
    return places[np.argsort(far, kind="stable")]
