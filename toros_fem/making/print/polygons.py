"""Small operations on polygons that several steps of a print share."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import reduce

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.meshes.panels import polygons_of, runs_of_ring

# Two borders closer than this fraction of the resolution are the same.
TOUCHING = 1e-3
# Corners of a quarter of a circle.
QUARTER = 10

# A change of a part of a border, points (n, 2), that is a whole ring or a run between fixed ends.
Change = Callable[[Floats, bool], Floats]


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
