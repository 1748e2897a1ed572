"""Places of flat panels beside each other: turned upright, and packed in rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.meshes.pattern import Pattern

# Gap between panels as a fraction of the side of a square of their whole area.
GAP = 0.04
# Panels whose bounding boxes are closer than this fraction of the drawing's size touch.
TOUCHING = 1e-6
# Panels are turned in a picture if it becomes this many times larger.
LARGER = 1.1
# Rounding that two sizes may differ by, in m.
FITS = 1e-9
# Number of widths of rows that are tried.
WIDTHS = 12


@dataclass(frozen=True, eq=False)
class Place:
    """The place of a panel in a picture.

    Attributes:
        turned: Whether the panel is turned by 90° clockwise.
        offset: Translation after the turn, (2,), in m.
    """

    turned: bool
    offset: Floats

    def points(self, points: Floats) -> Floats:
        """Return points of the panel's chart, (…, 2), in the picture, in m."""
        return self.vectors(points) + self.offset

    def vectors(self, vectors: Floats) -> Floats:
        """Return vectors of the panel's chart, (…, 2), in the picture."""
        return np.stack([vectors[..., 1], -vectors[..., 0]], axis=-1) if self.turned else vectors

    def region(self, region: BaseGeometry) -> BaseGeometry:
        """Return a region of the panel's chart in the picture, in m."""
        turn = [0, 1, -1, 0] if self.turned else [1, 0, 0, 1]
        return affine_transform(region, [*turn, *self.offset])


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


def panel_places(pattern: Pattern, gap: float, page: tuple[float, float]) -> list[Place]:
    """Return the places of all panels in a picture that shows them as large as a page allows.

    Slim panels may be turned, all alike. Panels that are apart in the flat plane keep their places
    beside each other; others are packed in rows, small ones above each other.

    Args:
        pattern: The pattern.
        gap: Gap between panels that are packed here, in m.
        page: Width and height of the page, in any unit.
    """
    corners = [
        pattern.corners[pattern.panel == panel].reshape(-1, 2)
        for panel in range(len(pattern.panel_names))
    ]
    best: tuple[float, list[Place]] = 0.0, []
    for turned in (False, True):
        here = Place(turned, np.zeros(2))
        low = np.array([here.points(points).min(axis=0) for points in corners])
        high = np.array([here.points(points).max(axis=0) for points in corners])
        sizes = high - low
        if _apart(low, high):
            packed = [low - low.min(axis=0)]
        else:
            widths = np.linspace(sizes[:, 0].max(), (sizes[:, 0] + gap).sum(), WIDTHS)
            packed = [_in_rows(sizes, float(width), gap, stacked=True) for width in widths]
        for lower in packed:
            scale = float((np.array(page) / (lower + sizes).max(axis=0)).min())
            if scale > best[0] * (LARGER if turned and not best[1][0].turned else 1 + 1e-9):
                best = scale, [Place(turned, offset) for offset in lower - low]
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
    frame = shapely.oriented_envelope(shapely.MultiPoint(points))
    corners = shapely.get_coordinates(frame)
    sides = np.diff(corners[:3], axis=0)
    long = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    turn = np.exp(1j * (np.pi / 2 - np.arctan2(long[1], long[0])))
    place = (points @ [1, 1j]) * turn
    turned = np.column_stack([place.real, place.imag])
    return turned - turned.min(axis=0)
