"""Smooth curves along the contours of a density."""

from __future__ import annotations

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.making.print.polygons import changed_border, polygons_of

# Distance of points on a smooth curve, over the smoothing length.
STEP = 1 / 6
# A ring shorter than this many smoothing lengths stays as it is: it would shrink.
SHORTEST = 6.0
# Borders closer than this fraction of the smoothing length are the same.
TOUCHING = 1e-6


def smoothed(region: BaseGeometry, outline: BaseGeometry, length: float) -> BaseGeometry:
    """Return a region whose border, where it is not that of its panel, is a smooth curve.

    Points along the border are averaged with a Gaussian weight, whose standard deviation is the
    length in m, twice as 2 G − G²: waves shorter than about twice the length vanish, those longer
    than eight times it keep 99 % of their height, so that lines neither shrink nor part. Ends on
    the border of the panel stay.
    """

    def smooth(points: Floats, closed: bool) -> Floats:
        if not closed:
            return _averaged(_even(points, length), closed=False)
        ring = np.concatenate([points, points[:1]])
        if shapely.length(shapely.linestrings(ring)) < SHORTEST * length:
            return points
        return _averaged(_even(ring, length)[:-1], closed=True)

    found = changed_border(region, outline, TOUCHING * length, smooth)
    parts = polygons_of(found.intersection(outline))
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(list(parts))


def _even(line: Floats, length: float) -> Floats:
    """Return points at equal distances along a line, both ends included."""
    curve = shapely.linestrings(line)
    count = max(2, int(np.ceil(curve.length / (STEP * length))))
    return shapely.get_coordinates(
        shapely.line_interpolate_point(curve, np.linspace(0, 1, count + 1), normalized=True)
    )


def _averaged(points: Floats, *, closed: bool) -> Floats:
    """Return evenly spaced points (n, 2), averaged along a ring or between fixed ends."""
    sigma, mode, n = 1 / STEP, "wrap", len(points)
    if not closed:
        # An odd continuation at both ends keeps them.
        back, on = 2 * points[0] - points[:0:-1], 2 * points[-1] - points[-2::-1]
        points, mode = np.concatenate([back, points, on]), "nearest"
    once = gaussian_filter1d(points, sigma, axis=0, mode=mode)
    twice = np.asarray(2 * once - gaussian_filter1d(once, sigma, axis=0, mode=mode))
    if closed:
        return twice
    inner = twice[n - 1 : 2 * n - 1]
    inner[0], inner[-1] = points[n - 1], points[2 * n - 2]
    return inner
