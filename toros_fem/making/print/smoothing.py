"""Smooth curves along the contours of a density."""

from __future__ import annotations

from functools import reduce
from itertools import pairwise

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats

# Distance of points on a smooth curve, over the smoothing length.
STEP = 1 / 6
# A ring shorter than this many smoothing lengths stays as it is: it would shrink.
SHORTEST = 6.0
# Borders closer than this fraction of the smoothing length are the same.
TOUCHING = 1e-6


def smoothed(region: BaseGeometry, outline: BaseGeometry, length: float) -> BaseGeometry:
    """Return a region whose border, where it is not that of its panel, is a smooth curve.

    Points along the border are averaged with a Gaussian weight, twice as 2 G − G²: waves shorter
    than about twice the length vanish, those longer than eight times it keep 99 % of their height,
    so that lines neither shrink nor part. Ends on the border of the panel stay.

    Args:
        region: Polygons in m, inside the panel.
        outline: Outline of the panel.
        length: Standard deviation of the weight along the border, in m.
    """
    cut = outline.boundary
    shapely.prepare(cut)
    smooth = []
    for polygon in shapely.get_parts(region):
        for ring in (polygon.exterior, *polygon.interiors):
            points = _smooth_ring(shapely.get_coordinates(ring)[:-1], cut, length)
            smooth.append(shapely.make_valid(shapely.Polygon(points), method="structure"))
    # Even and odd: rings inside others are their holes.
    found = reduce(shapely.symmetric_difference, smooth, shapely.Polygon())
    return _polygons(found.intersection(outline))


def _smooth_ring(points: Floats, cut: BaseGeometry, length: float) -> Floats:
    """Return the points of a ring (n, 2), averaged along it where it is off the cut."""
    free = ~shapely.dwithin(cut, shapely.points(points), TOUCHING * length)
    if free.all():
        closed = np.concatenate([points, points[:1]])
        if shapely.length(shapely.linestrings(closed)) < SHORTEST * length:
            return points
        return _averaged(_even(closed, length)[:-1], closed=True)
    begin = int(np.argmin(free))
    points, free = np.roll(points, -begin, axis=0), np.roll(free, -begin)
    closed, free = np.concatenate([points, points[:1]]), np.append(free, False)
    # Runs between two points on the cut, each with both of these.
    stops = np.flatnonzero(~free)
    pieces = []
    for a, b in pairwise(stops):
        run = closed[a : b + 1]
        if b > a + 1 or not _along(run, cut, length):
            run = _averaged(_even(run, length), closed=False)
        pieces.append(run[:-1])
    return np.concatenate(pieces)


def _along(run: Floats, cut: BaseGeometry, length: float) -> bool:
    """Return whether a single edge lies on the cut."""
    return bool(shapely.dwithin(cut, shapely.points(run.mean(axis=0)), TOUCHING * length))


def _even(line: Floats, length: float) -> Floats:
    """Return points at equal distances along a line, both ends included."""
    curve = shapely.linestrings(line)
    count = max(2, int(np.ceil(curve.length / (STEP * length))))
    return shapely.get_coordinates(
        shapely.line_interpolate_point(curve, np.linspace(0, 1, count + 1), normalized=True)
    )


def _averaged(points: Floats, *, closed: bool) -> Floats:
    """Return evenly spaced points (n, 2), averaged along a ring or between fixed ends."""
    sigma = 1 / STEP
    if closed:
        once = gaussian_filter1d(points, sigma, axis=0, mode="wrap")
        return np.asarray(2 * once - gaussian_filter1d(once, sigma, axis=0, mode="wrap"))
    # An odd continuation at both ends keeps them.
    n = len(points)
    back = 2 * points[0] - points[:0:-1]
    on = 2 * points[-1] - points[-2::-1]
    longer = np.concatenate([back, points, on])
    once = gaussian_filter1d(longer, sigma, axis=0, mode="nearest")
    twice = 2 * once - gaussian_filter1d(once, sigma, axis=0, mode="nearest")
    inner = np.asarray(twice[n - 1 : 2 * n - 1])
    inner[0], inner[-1] = points[0], points[-1]
    return inner


def _polygons(shape: BaseGeometry) -> BaseGeometry:
    """Return the polygons of a shape, without lines and points."""
    parts = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts) if len(parts) != 1 else parts[0]
