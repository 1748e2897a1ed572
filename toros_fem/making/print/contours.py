"""Contours of the density as polygons on the flat panels, and smooth curves along them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import reduce

import numpy as np
import shapely
from scipy.ndimage import gaussian_filter1d
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Floats, Ints
from toros_fem.meshes.panels import polygons_of, runs_of_ring
from toros_fem.meshes.pattern import Pattern

# Two borders closer than this fraction of the resolution are the same.
TOUCHING = 1e-3
# Corners of a quarter of a circle.
QUARTER = 10
# A change of a part of a border, points (n, 2), that is a whole ring or a run between fixed ends.
Change = Callable[[Floats, bool], Floats]
# Values this close to the threshold count as equal to it, so that the contour passes through the
# vertex. Otherwise rounding would merge corners of very thin polygons.
SNAP = 1e-9
# Distance of points on a smooth curve, over the smoothing length.
STEP = 1 / 6
# A ring shorter than this many smoothing lengths stays as it is: it would shrink.
SHORTEST = 6.0
# Borders closer than this fraction of the smoothing length are the same.
ON_OUTLINE = 1e-6


def solid(shape: BaseGeometry, resolution: float) -> BaseGeometry:
    """Return the polygons of a shape without slivers of rounding, lines and points.

    The resolution is the distance in m of the samples that widths are measured by.
    """
    apart = TOUCHING * resolution
    thick = shape.buffer(-apart, join_style="mitre").buffer(2 * apart, join_style="mitre")
    return shapely.MultiPolygon(list(polygons_of(shape.intersection(thick))))


def fabric_of(region: BaseGeometry, outline: BaseGeometry, resolution: float) -> BaseGeometry:
    """Return the part of a panel that is not printed, as `solid` does."""
    return solid(outline.difference(region), resolution)


def opened(region: BaseGeometry, radius: float) -> BaseGeometry:
    """Return the union of all discs of a radius that lie in a region."""
    return region.buffer(-radius, quad_segs=QUARTER).buffer(radius, quad_segs=QUARTER)


def pieces_and_holes(region: BaseGeometry) -> tuple[int, int]:
    """Return the number of pieces of a region, and of all their holes."""
    pieces = [piece for piece in shapely.get_parts(region) if not piece.is_empty]
    return len(pieces), sum(len(piece.interiors) for piece in pieces)


def even_odd(rings: Iterable[Floats]) -> BaseGeometry:
    """Return the region inside an odd number of rings, points (n, 2) each.

    Those of two points, to which slivers are simplified, have no inside.
    """
    wide = [ring for ring in rings if len(ring) > 2]
    shapes = [shapely.make_valid(shapely.Polygon(ring), method="structure") for ring in wide]
    return reduce(shapely.symmetric_difference, shapes, shapely.Polygon())


def changed_border(
    region: BaseGeometry, outline: BaseGeometry, near: float, change: Change
) -> BaseGeometry:
    """Return a region in a panel with another border, but where that is the panel's own.

    Points closer than `near`, in m, to the outline lie on it.
    """
    cut = outline.boundary
    shapely.prepare(cut)
    rings = shapely.get_rings(shapely.get_parts(region))
    return even_odd(
        _changed_ring(shapely.get_coordinates(ring)[:-1], cut, near, change) for ring in rings
    )


def simplified(
    region: BaseGeometry, outline: BaseGeometry, near: float, distance: float
) -> BaseGeometry:
    """Return a region with fewer corners, as of `changed_border`; it moves by a distance in m."""

    def change(points: Floats, closed: bool) -> Floats:
        line = shapely.LinearRing(points) if closed else shapely.LineString(points)
        found = shapely.get_coordinates(line.simplify(distance))
        return found[:-1] if closed else found

    return changed_border(region, outline, near, change)


def _changed_ring(points: Floats, cut: BaseGeometry, near: float, change: Change) -> Floats:
    """Return the points of a ring (n, 2), changed where it is off the cut."""
    runs = runs_of_ring(points, cut, near)
    if runs is None:
        return change(points, True)
    return np.concatenate([(change(run, False) if off else run)[:-1] for run, off in runs])


def printed_regions(
    pattern: Pattern, at_points: Floats, at_centroids: Floats, threshold: float
) -> list[BaseGeometry]:
    """Return the printed region of each panel, where the density exceeds the threshold η.

    Each triangle is split into three at its centroid. The density is linear on each third, so that
    the values ρ̃ at flat points, (m,), and at centroids, (t,), are met exactly.
    """
    count = len(pattern.flat_points)
    points = np.concatenate([pattern.flat_points, pattern.centroids])
    value = np.concatenate([at_points, at_centroids]) - threshold
    value[np.abs(value) < SNAP] = 0
    panels = [np.flatnonzero(pattern.panel == k) for k in range(len(pattern.panel_names))]
    return [_positive(points, value, pattern.flat_triangles[k], count + k) for k in panels]


def _positive(points: Floats, value: Floats, corner: Ints, centre: Ints) -> BaseGeometry:
    """Return where values are positive, of triangles by their corners (t, 3) and centroids (t,)."""
    centre = centre[:, None]
    whole = np.all(value[corner] > 0, axis=1) & (value[centre[:, 0]] > 0)
    thirds = np.stack([corner, np.roll(corner, -1, axis=1), np.repeat(centre, 3, axis=1)], axis=2)
    third = thirds[~whole].reshape(-1, 3)
    inside = value[third] > 0
    below = np.any(value[third] < 0, axis=1)
    corners = [
        points[corner[whole]],
        points[third[inside.any(axis=1) & ~below]],
        *_cut(points, value, third[inside.any(axis=1) & below]),
    ]
    polygons = np.concatenate(
        [shapely.polygons(c) for c in corners if len(c)] or [np.empty(0, object)]
    )
    return shapely.coverage_union_all(polygons)


def _cut(points: Floats, value: Floats, triangles: Ints) -> tuple[Floats, Floats]:
    """Return the positive parts of triangles with values of both signs, (k, 3, 2) and (l, 4, 2)."""
    inside = value[triangles] > 0
    lone = inside.sum(axis=1) == 1
    apart = np.argmax(inside == lone[:, None], axis=1)  # the corner alone on its side
    order = (apart[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, order, axis=1).T
    ab, ac = _crossing(points, value, a, b), _crossing(points, value, a, c)
    tips = np.stack([points[a], ab, ac], axis=1)[lone]
    return tips, np.stack([ab, points[b], points[c], ac], axis=1)[~lone]


def _crossing(points: Floats, value: Floats, a: Ints, b: Ints) -> Floats:
    """Return where edges cross 0; the same to rounding from both sides, exact at a vertex of 0."""
    outer, inner = np.where(value[a] > 0, [b, a], [a, b])
    fraction = value[outer] / (value[outer] - value[inner])
    return points[outer] + fraction[:, None] * (points[inner] - points[outer])


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

    found = changed_border(region, outline, ON_OUTLINE * length, smooth)
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
    ends, beyond = points[[0, -1]], 0 if closed else len(points) - 1
    mode = "wrap" if closed else "nearest"
    # An odd continuation at both ends keeps them.
    longer = np.pad(points, ((beyond, beyond), (0, 0)), "reflect", reflect_type="odd")
    once = gaussian_filter1d(longer, 1 / STEP, axis=0, mode=mode)
    twice = np.asarray(2 * once - gaussian_filter1d(once, 1 / STEP, axis=0, mode=mode))
    found = twice[beyond : beyond + len(points)]
    if not closed:
        found[[0, -1]] = ends
    return found
