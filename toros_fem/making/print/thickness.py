"""Lines and gaps made as wide as the printer needs them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats
from toros_fem.making.print.polygons import (
    QUARTER,
    TOUCHING,
    fabric_of,
    opened,
    pieces_and_holes,
    solid,
)
from toros_fem.making.print.widths import narrow_discs
from toros_fem.meshes.panels import polygons_of

# Relative excess of widths, since discs are polygons and lie at a distance from each other; a
# third of it is what widths must keep.
EXCESS = 0.015
# Distance of samples on borders, over the least width.
SAMPLES = 1 / 15
# Distance of discs along a line, over their radius.
APART = 0.2
# A line that meets the border of the panel along less than this many limits crosses it, and does
# not run along it.
CROSSING = 6.0
# Radius of corners over half the least width: with 1, lines of just that width would part.
ROUND = 0.95
# Rounds in which narrow gaps are widened; those that come back are filled afterwards.
WIDENING = 4
ROUNDS = 16
# Depth of wear from both sides that no line may part by, over the least width.
WORN = 0.47
# How far the corners of a polygon in place of a circle are beside it, over the radius.
ARC = 0.004


def thickened(
    region: BaseGeometry, outline: BaseGeometry, width: float, gap: float, area: float
) -> BaseGeometry:
    """Return the print of a panel with lines and gaps that are wide enough, and round corners.

    What is narrower than half its limit goes: such lines are removed, such gaps filled. What is
    wider gets the limit: along its middle, discs are added to a line, or cut out of the sides of a
    gap. So the border moves by a quarter of the limit at most; only where lines and gaps that are
    both too narrow lie side by side, gaps are filled. Corners get a radius of nearly half the
    limit. At the border of the panel lines run out as they come. The limits are least widths in m;
    holes, and fabric between print and border, have a least area in m².
    """
    lines, gaps = _Discs(outline, width), _Discs(outline, gap)

    def within(shape: BaseGeometry) -> BaseGeometry:
        return solid(shape.intersection(outline), lines.resolution)

    def filled(region: BaseGeometry, parts: BaseGeometry) -> BaseGeometry:
        # A little larger, or borders that differ by rounding would leave a slit.
        return within(region.union(parts.buffer(gaps.rounding, join_style="mitre")))

    def fabric(region: BaseGeometry) -> BaseGeometry:
        return fabric_of(region, outline, gaps.resolution)

    region = within(region)
    region = filled(region, _flimsy(fabric(region), gap))
    region = within(region.difference(_flimsy(region, width).buffer(lines.rounding)))
    rounded = False
    for number in range(ROUNDS):
        bare = shapely.get_parts(fabric(region))
        small = shapely.MultiPolygon(list(bare[shapely.area(bare) < area]))
        region = filled(region, small)
        thin, tight = lines.narrow(region), gaps.narrow(fabric(region))
        if not len(thin[0]) and not len(tight[0]):
            if rounded:
                break
            # Corners of lines that are too thin would take the lines away: they come last.
            region, rounded = within(_rounded(region, outline, width, gap)), True
            continue
        rounded = False
        if number < WIDENING:
            region = region.difference(gaps.union(*tight))
        else:
            region = region.union(gaps.union(tight[0], np.zeros_like(tight[1])))
        region = region.union(lines.union(*thin))
        region = within(region)
    return region


class _Discs:
    """Discs as wide as the least width, inside a panel."""

    def __init__(self, outline: BaseGeometry, limit: float) -> None:
        self.radius = (1 + EXCESS) * limit / 2
        self.limit = limit
        self.resolution = SAMPLES * limit
        self.rounding = TOUCHING * self.resolution
        self._least = (1 + EXCESS / 3) * limit
        self._outline = outline
        self._core = outline.buffer(-self.radius)

    def narrow(self, region: BaseGeometry) -> tuple[Floats, Bools]:
        """Return where a region is too narrow, (n, 2), and whether the cut is a side there."""
        # A line that is cut ends beyond the cut, where its width does not count; but slivers along
        # the cut are seen without that.
        longer = _beyond(region, self._outline, self.limit, CROSSING * self.limit)
        for shape in (longer, region):
            near = _doubtful(shape, self._least)
            if near.is_empty:
                continue
            centres, at_cut = narrow_discs(
                shape, self._outline.boundary, self._least, self.resolution, near
            )
            inside = shapely.contains_xy(self._outline, centres)
            if inside.any():
                return centres[inside], at_cut[inside]
        necks = _necks(region, WORN * self.limit, APART * self.radius)
        return necks, np.zeros(len(necks), dtype=bool)

    def union(self, centres: Floats, inward: Bools) -> BaseGeometry:
        """Return the union of discs at centres (n, 2); of some also moved inside the panel."""
        grid = np.round(centres / (APART * self.radius)).astype(np.int64)
        chosen = np.unique(grid, axis=0, return_index=True)[1]
        points = shapely.points(centres[chosen])
        if inward.any() and not self._core.is_empty:
            nearest = shapely.get_point(shapely.shortest_line(points, self._core), 1)
            # Where the panel itself is narrow there is no room.
            near = shapely.distance(points, nearest) <= self.radius
            points = np.concatenate([points, nearest[near & inward[chosen]]])
        return shapely.MultiPoint(points).buffer(self.radius, quad_segs=QUARTER)


def _doubtful(region: BaseGeometry, limit: float) -> BaseGeometry:
    """Return where a region may be narrower than a limit; nowhere else it is."""
    core = region.buffer(-limit / 2, quad_segs=QUARTER)
    if pieces_and_holes(core) != pieces_and_holes(region):
        return region
    # What a disc cannot reach is a corner, if it is small.
    lost = region.difference(core.buffer((1 + ARC) * limit / 2, quad_segs=QUARTER))
    return _without_corners(lost, limit)


def _necks(region: BaseGeometry, depth: float, apart: float) -> Floats:
    """Return points (n, 2) on the ways between parts of a piece that wear of a depth would sever.

    Widths between facing sides leave out necks of short pieces.
    """
    ways: list[BaseGeometry] = []
    for piece in shapely.get_parts(region):
        left = shapely.get_parts(piece.buffer(-depth, quad_segs=QUARTER))
        # Each with the nearest of those before it.
        ways += [
            shapely.shortest_line(left[k], shapely.union_all(left[:k])) for k in range(1, len(left))
        ]
    if not ways:
        return np.empty((0, 2))
    return shapely.get_coordinates(shapely.segmentize(ways, apart))


def _flimsy(region: BaseGeometry, limit: float) -> BaseGeometry:
    """Return the parts of a region that are narrower than half a limit, without corners."""
    return _without_corners(region.difference(opened(region, limit / 4)), limit)


def _without_corners(lost: BaseGeometry, limit: float) -> BaseGeometry:
    """Return the parts of a region that are longer than a limit."""

    def long(shape: BaseGeometry) -> npt.NDArray[np.object_]:
        parts = polygons_of(shape)
        low, high = np.split(shapely.bounds(parts), 2, axis=1)
        return parts[np.hypot(*(high - low).T) >= limit]

    # Most are short, and slow to free from slivers.
    return shapely.union_all(long(solid(shapely.MultiPolygon(list(long(lost))), limit)))


def _rounded(region: BaseGeometry, outline: BaseGeometry, width: float, gap: float) -> BaseGeometry:
    """Return a region with round corners, but where it meets the border of its panel."""
    longer = opened(_beyond(region, outline, max(width, gap)), ROUND * width / 2)
    closed = longer.buffer(ROUND * gap / 2, quad_segs=QUARTER)
    return closed.buffer(-ROUND * gap / 2, quad_segs=QUARTER)


def _beyond(
    region: BaseGeometry, outline: BaseGeometry, limit: float, longest: float = np.inf
) -> BaseGeometry:
    """Return a region that goes on beyond the border of its panel, at right angles to it.

    Where it meets the border along more than the longest stretch, it ends there.
    """
    met = outline.boundary.intersection(region.buffer(1e-6 * limit))
    stretches = shapely.get_parts(shapely.line_merge(met))
    length = shapely.length(stretches)
    ends = shapely.union_all(stretches[(length > 0) & (length <= longest)])
    longer = ends.buffer(2 * limit, cap_style="flat").difference(outline)
    # A little larger, or borders that differ by rounding would leave a slit.
    return region.union(longer.buffer(1e-6 * limit, join_style="mitre"))
