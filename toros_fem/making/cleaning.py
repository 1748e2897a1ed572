"""A print that can be made: smooth contours, wide lines and gaps, no islands."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import override

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Bools, Floats, is_number, shown
from toros_fem.making.contours import (
    QUARTER,
    TOUCHING,
    fabric_of,
    narrow_discs,
    opened,
    pieces_and_holes,
    simplified,
    smoothed,
    solid,
)
from toros_fem.making.printability import (
    BEYOND,
    DEFAULT_LIMITS,
    PanelRegion,
    PrintLimits,
    beyond_seams,
    find_holes,
    find_pieces,
    part_regions,
    with_more,
)
from toros_fem.meshes.panels import Affine, polygons_of
from toros_fem.meshes.pattern import Mirrored, Pattern, Regions

# Width of a bridge to an island, over the least width, and over the smoothing length: so wide that
# the mesh of the density sees it too.
BRIDGE = 2.0
SEEN = 3.0
# Corners of regions that are joined across a cut lie on a grid of this fraction of the skin's size.
GRID = 1e-9


@dataclass(frozen=True, eq=False)
class CleanedRegions:
    """A print that can be made, and what it was made of.

    Attributes:
        contours: Print before any cleaning.
        regions: The print.
        dropped: Free islands that were removed.
        bridged: Free islands that were joined to the rest by a line.
        filled: Holes that were filled.
        island_area: Area in m² below which free islands were removed.
    """

    contours: list[BaseGeometry]
    regions: list[BaseGeometry]
    dropped: tuple[PanelRegion, ...]
    bridged: tuple[PanelRegion, ...]
    filled: tuple[PanelRegion, ...]
    island_area: float


def require_island_area(pattern: Pattern, island_area: float) -> None:
    """Check that the area in m² below which islands are removed is smaller than the pattern."""
    whole = float(pattern.areas.sum())
    if not (is_number(island_area) and (0 <= island_area < whole or math.isinf(island_area))):
        raise ParameterError(
            f"island_area = {shown(island_area)} m² must be at least 0 and below the pattern's "
            f"{whole:.3g} m²; 0 bridges all islands, math.inf removes all. 20 mm² are 20e-6.",
            "island_area",
        )


class Panels:
    """What a print is cleaned on: all panels of a pattern, whose print ends at their outlines.

    Attributes:
        outlines: What is cleaned together: the outline of each panel, polygons in m.
        parts: What is kept of each, and has images that make up the whole, polygons in m.
        repeats: Whether a piece has images, so that what joins it gets them too.
        sewn: Whether the print goes on across straight seams, so that lines meet there.
    """

    repeats = False
    sewn = True

    def __init__(self, pattern: Pattern) -> None:
        self.pattern = pattern
        self.outlines = self.parts = pattern.outlines

    def laid(self, regions: Regions) -> list[BaseGeometry]:
        """Return the print inside each outline, of the print on each panel."""
        return list(regions)

    def islands(self, laid: Regions, limits: PrintLimits) -> list[PanelRegion]:
        """Return the free islands, the largest first; of those that repeat one."""
        return [p for p in find_pieces(self.pattern, laid, limits.contact) if not p.attached]

    def images(self, shape: BaseGeometry) -> BaseGeometry:
        """Return a piece of print with all its copies."""
        return shape

    def part(self, laid: Regions, detail: float) -> list[BaseGeometry]:
        """Return the print on each part; narrower differences of images are rounding, in m."""
        return list(laid)

    def whole(self, own: Regions) -> list[BaseGeometry]:
        """Return the print on each panel, of the print on each part."""
        return list(own)


class MirroredPanels(Panels):
    """All panels of a whole skin, whose print is exactly symmetric; a part of it is designed."""

    repeats = True

    def __init__(self, part: Pattern, whole: Mirrored) -> None:
        super().__init__(whole.pattern)
        self._part, self._whole = part, whole
        self.parts = part.outlines

    @override
    def part(self, laid: Regions, detail: float) -> list[BaseGeometry]:
        own = part_regions(self._part, laid)
        for panel, image, place in self._images():
            there = place.inverse.region(laid[image])
            own[panel] = with_more(own[panel], there, self.parts[panel], detail)
        return own

    @override
    def whole(self, own: Regions) -> list[BaseGeometry]:
        pieces: list[list[BaseGeometry]] = [[] for _ in self.outlines]
        for panel, image, place in self._images():
            pieces[image].append(place.region(own[panel]))
        grid = GRID * self.pattern.size
        return [p[0] if len(p) == 1 else shapely.union_all(p, grid_size=grid) for p in pieces]

    def _images(self) -> Iterator[tuple[int, int, Affine]]:
        """Yield each panel of the part, its panel in each image, and the map to it."""
        part, whole, count = self._part, self._whole, len(self._part.panel)
        for image in range(whole.parts):
            cells = slice(image * count, (image + 1) * count)
            corners, panels = self.pattern.flat_triangles[cells], self.pattern.panel[cells]
            for own in range(len(part.panel_names)):
                here = np.flatnonzero(part.panel[whole.cell[cells]] == own)
                points = np.unique(corners[here])
                source, target = (
                    part.flat_points[whole.flat[points]],
                    self.pattern.flat_points[points],
                )
                yield own, int(panels[here[0]]), Affine.fit(source, target)


def panels_of(part: Pattern, whole: Mirrored) -> Panels:
    """Return the panels that are cleaned: those of the whole skin, of which a part is designed."""
    return Panels(part) if whole.parts == 1 else MirroredPanels(part, whole)


def clean(
    domain: Panels,
    regions: Regions,
    limits: PrintLimits = DEFAULT_LIMITS,
    island_area: float = 0.0,
    smoothing: float | None = None,
) -> CleanedRegions:
    """Return regions that can be printed: no thin line or gap, no small hole, no free island.

    Args:
        island_area: Free islands smaller than this are removed, in m²; larger ones are joined to
            the rest of their panel by a line, where one fits.
        smoothing: Length in m of `smoothed`, for contours on a mesh; None for polygons that are
            smooth.
    """
    found, own = _clean(domain, regions, limits, island_area, smoothing)
    if found.bridged and domain.repeats:  # bridges get images, which may lie close to others
        _, own = _clean(domain, found.regions, limits, island_area, None)
    # Smoothed contours have a corner every 10 to 200 µm: files would be several times as large, and
    # cutters stop at each.
    near = TOUCHING * limits.resolution
    own = [
        simplified(region, outline, near, limits.simplified)
        for region, outline in zip(own, domain.parts, strict=True)
    ]
    return replace(found, regions=domain.whole(own))


def _clean(
    domain: Panels,
    regions: Regions,
    limits: PrintLimits,
    island_area: float,
    smoothing: float | None,
) -> tuple[CleanedRegions, list[BaseGeometry]]:
    """Return a clean print with all of its corners, and what of it lies on each part."""
    made = _all_cleaned(domain, domain.laid(regions), limits, smoothing)
    width = BRIDGE * limits.width
    if smoothing is not None:
        width = max(width, SEEN * smoothing)
    islands, bridged = domain.islands(made, limits), list[PanelRegion]()
    for panel in sorted({island.panel for island in islands}):
        outline, pieces = domain.outlines[panel], [p for p in islands if p.panel == panel]
        free = shapely.union_all([domain.images(piece.polygon) for piece in pieces])
        rest, joined = made[panel].difference(free.buffer(limits.resolution)), shapely.Polygon()
        for piece in (piece for piece in pieces if piece.area >= island_area):
            line = _bridge(piece.polygon, shapely.union_all([rest, joined]), outline, width)
            if line is not None:
                bridged.append(piece)
                both = shapely.union_all([piece.polygon, line])
                joined = shapely.union_all([joined, domain.images(both)])
        made[panel] = shapely.union_all([rest, joined])
    if bridged:
        made = _all_cleaned(domain, made, limits, None)
    filled = tuple(h for h in find_holes(domain.pattern, regions) if h.area < limits.hole_area)
    own = domain.part(made, limits.resolution)
    cleaned = CleanedRegions(
        contours=list(regions),
        regions=domain.whole(own),
        dropped=tuple(island for island in islands if island not in bridged),
        bridged=tuple(island for island in islands if island in bridged),
        filled=filled,
        island_area=island_area,
    )
    return cleaned, own


def _all_cleaned(
    domain: Panels, laid: Regions, limits: PrintLimits, smoothing: float | None
) -> list[BaseGeometry]:
    """Return the print inside each outline with smooth and wide lines, which meet at seams.

    At a straight seam the print is cleaned with what goes on beyond it. By itself each side would
    be rounded as if its lines ran on at right angles, and they would end beside each other.
    """
    found, outlines = list(laid), list(domain.outlines)
    if domain.sewn:
        margin = BEYOND * max(limits.width, limits.gap, smoothing or 0.0)
        found, outlines = beyond_seams(domain.pattern, laid, margin)
    made = [
        _cleaned(region, outline, limits, smoothing)
        for region, outline in zip(found, outlines, strict=True)
    ]
    longer = [outline is not own for outline, own in zip(outlines, domain.outlines, strict=True)]
    return [
        solid(region & own, limits.resolution) if more else region
        for region, own, more in zip(made, domain.outlines, longer, strict=True)
    ]


def _cleaned(
    region: BaseGeometry, outline: BaseGeometry, limits: PrintLimits, smoothing: float | None
) -> BaseGeometry:
    """Return the print of a panel with smooth and wide lines."""
    if region.is_empty:
        return region
    if fabric_of(region, outline, limits.resolution).is_empty:
        return outline
    if smoothing is not None:
        region = smoothed(region, outline, smoothing)
    return thickened(region, outline, limits.width, limits.gap, limits.hole_area)


def _bridge(
    island: BaseGeometry, rest: BaseGeometry, outline: BaseGeometry, width: float
) -> BaseGeometry | None:
    """Return a line from an island to the rest of its panel; None where the panel has no room."""
    if rest.is_empty:
        return None
    line = shapely.shortest_line(island, rest)
    if not outline.covers(line):
        return None
    ends = shapely.get_coordinates(line)
    way = ends[1] - ends[0]
    # Into both, so that it meets them over its whole width. What is left of a small piece at the
    # rim may be shorter than that.
    way *= width / 2 / max(float(np.hypot(*way)), 1e-12)
    return shapely.LineString([ends[0] - way, ends[1] + way]).buffer(width / 2) & outline


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
