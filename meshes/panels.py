"""Panels as polygons: their places beside each other, and regions cut by their triangles."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.affine import Affine
from toros_fem.meshes.pattern import Pattern

Polygons: TypeAlias = npt.NDArray[np.object_]

# Gap between panels as a fraction of the side of a square of their whole area.
GAP = 0.04
# Widths of rows over this side: of panels turned upright, and of panels as they are.
UPRIGHT_WIDTH, ROW_WIDTH = 1.3, 2.5
# Panels whose bounding boxes are closer than this fraction of the drawing's size touch.
TOUCHING = 1e-6
# Panels are turned in a picture if it becomes this many times larger.
LARGER = 1.1
# Rounding that two sizes may differ by, in m.
FITS = 1e-9
# Number of widths of rows that are tried.
WIDTHS = 12
# Corners of the pieces that a region is divided into before it is cut by triangles.
PIECE = 40

# --------------------------------------------------------------------------- beside each other


def arranged(panels: Sequence[Floats]) -> list[Floats]:
    """Turn panels, given by flat points (m, 2), upright, and pack them in rows.

    They are rotated and translated into the first quadrant, in m. No two overlap.
    """
    upright = [_upright(points) for points in panels]
    sizes = np.array([points.max(axis=0) for points in upright])
    side = float(np.sqrt(sizes.prod(axis=1).sum()))
    corners = _in_rows(sizes, UPRIGHT_WIDTH * side, GAP * side)
    return [points + corner for points, corner in zip(upright, corners, strict=True)]


def panel_places(
    pattern: Pattern, gap: float, page: tuple[float, float] | None = None
) -> list[Affine]:
    """Return the maps of all panels into a picture, whose lower left corner is the origin.

    Panels that are apart in the flat plane, as those of `unwrap`, keep their places beside each
    other. Others, as those of `cylinder`, are packed in rows, with a gap in m.

    On a page, of a width and height in any unit, all become as large as possible: slim panels may
    be turned by 90° clockwise, all alike, and small ones stand above each other.
    """
    corners = [
        pattern.corners[pattern.panel == panel].reshape(-1, 2)
        for panel in range(len(pattern.panel_names))
    ]
    best: tuple[float, list[Affine]] = 0.0, []
    for angle in (0.0, -np.pi / 2) if page else (0.0,):
        here = Affine.turn(angle)
        low = np.array([here.points(points).min(axis=0) for points in corners])
        high = np.array([here.points(points).max(axis=0) for points in corners])
        sizes = high - low
        if _apart(low, high):
            packed = [low - low.min(axis=0)]
        elif page:
            widths = np.linspace(sizes[:, 0].max(), (sizes[:, 0] + gap).sum(), WIDTHS)
            packed = [_in_rows(sizes, float(width), gap, stacked=True) for width in widths]
        else:
            packed = [_in_rows(sizes, ROW_WIDTH * float(np.sqrt(sizes.prod(axis=1).sum())), gap)]
        for lower in packed:
            scale = float((np.array(page or (1, 1)) / (lower + sizes).max(axis=0)).min())
            first_turned = angle != 0 and best[1][0].angle == 0
            if scale > best[0] * (LARGER if first_turned else 1 + 1e-9):
                best = scale, [Affine.turn(angle, offset) for offset in lower - low]
    return best[1]


def _apart(low: Floats, high: Floats) -> bool:
    """Return whether no two boxes, given by their corners (p, 2), overlap or touch."""
    near = TOUCHING * float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    gaps = np.maximum(low[:, None] - high, low - high[:, None]).max(axis=2)
    return bool(np.all(gaps[np.triu_indices(len(low), 1)] > near))


def _in_rows(sizes: Floats, width: float, gap: float, *, stacked: bool = False) -> Floats:
    """Return the lower left corner of each rectangle, (p, 2), in rows of about this width.

    If they are stacked, lower rectangles stand above each other in a row as far as they fit.
    """
    width = max(width, float(sizes[:, 0].max()))
    corners = np.zeros_like(sizes)
    corner, height = np.zeros(2), 0.0
    below: int | None = None  # the last one of the row, if another may stand on it
    for k in np.argsort(-sizes[:, 1].round(9), kind="stable"):  # the tallest first
        size = sizes[k]
        if stacked and below is not None:
            above = corners[below] + [0, sizes[below, 1] + gap]
            if above[1] + size[1] <= corner[1] + height and size[0] <= sizes[below, 0] + FITS:
                corners[k], below = above, k
                continue
        if corner[0] > 0 and corner[0] + size[0] > width:
            corner, height = np.array([0.0, corner[1] + height + gap]), 0.0
        corners[k], below = corner, k
        corner = corner + [size[0] + gap, 0]
        height = max(height, float(size[1]))
    return corners


def _upright(points: Floats) -> Floats:
    """Return points turned so that their narrowest rectangle is upright, from the origin."""
    corners = shapely.get_coordinates(shapely.oriented_envelope(shapely.MultiPoint(points)))
    sides = np.diff(corners[:3], axis=0)
    long = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    turn = np.exp(1j * (np.pi / 2 - np.arctan2(long[1], long[0])))
    place = (points @ [1, 1j]) * turn
    turned = np.column_stack([place.real, place.imag])
    return turned - turned.min(axis=0)


# ---------------------------------------------------------------------------- cut by triangles


def cut_by_triangles(region: BaseGeometry, corners: Floats) -> tuple[Ints, Polygons]:
    """Return the parts of a region in triangles (t, 3, 2), polygons that only share borders.

    The triangle of each polygon, (k,), comes first.
    """
    triangles, pieces = shapely.polygons(corners), _divided(region)
    triangle, piece = shapely.STRtree(pieces).query(triangles, predicate="intersects")
    parts = shapely.intersection(triangles[triangle], pieces[piece])
    parts, origin = shapely.get_parts(parts, return_index=True)
    flat = _are_polygons(parts)
    return triangle[origin[flat]], parts[flat]


def polygons_of(shape: BaseGeometry) -> Polygons:
    """Return the polygons of a shape, without its lines and points."""
    parts = shapely.get_parts(shape)
    return parts[_are_polygons(parts)]


def runs_of_ring(
    points: Floats, cut: BaseGeometry, near: float
) -> list[tuple[Floats, bool]] | None:
    """Return the runs of a ring (n, 2) from one point on a cut to the next, each with both.

    With each run comes whether it is off the cut. Points closer than `near`, in m, lie on the cut;
    None where no point does.
    """
    free = ~shapely.dwithin(cut, shapely.points(points), near)
    if free.all():
        return None
    begin = int(np.argmin(free))
    closed = np.roll(points, -begin, axis=0)
    closed = np.concatenate([closed, closed[:1]])
    stops, found = np.append(np.flatnonzero(~np.roll(free, -begin)), len(points)), []
    for a, b in pairwise(stops):
        run = closed[a : b + 1]
        # A single edge lies on the cut, or leads across the panel.
        off = b > a + 1 or not shapely.dwithin(cut, shapely.Point(run.mean(axis=0)), near)
        found.append((run, bool(off)))
    return found


def _are_polygons(parts: Polygons) -> Bools:
    return np.asarray(shapely.get_type_id(parts) == shapely.GeometryType.POLYGON)


def _divided(region: BaseGeometry) -> Polygons:
    """Return pieces of a region with few corners each; they only share borders."""
    done: list[BaseGeometry] = []
    left = list(shapely.get_parts(region))
    while left:
        part = left.pop()
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        if shapely.get_num_coordinates(part) <= PIECE:
            done.append(part)
            continue
        x, y, right, top = part.bounds
        if right - x > top - y:
            middle = (x + right) / 2
            halves = (x, y, middle, top), (middle, y, right, top)
        else:
            middle = (y + top) / 2
            halves = (x, y, right, middle), (x, middle, right, top)
        for half in halves:
            left += list(shapely.get_parts(shapely.intersection(part, shapely.box(*half))))
    return np.array(done, dtype=object)
