"""A print that can be made: smooth contours, wide lines and gaps, no islands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import is_number, shown
from toros_fem.making.print.islands import Hole, PrintedPiece, find_holes, find_pieces
from toros_fem.making.print.printability import DEFAULT_LIMITS, PrintLimits
from toros_fem.making.print.regions import symmetric_regions
from toros_fem.making.print.smoothing import smoothed
from toros_fem.making.print.thickness import thickened
from toros_fem.making.print.widths import fabric_of
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.pattern import Pattern

# Width of a bridge to an island, over the least width, and over the smoothing length: so wide that
# the mesh of the density sees it too.
BRIDGE = 2.0
SEEN = 3.0


@dataclass(frozen=True, eq=False)
class CleanedRegions:
    """A print that can be made, and what it was made of.

    Attributes:
        contours: Regions on each panel before any cleaning, polygons in m.
        regions: Print on each panel, polygons in m.
        dropped: Free islands that were removed.
        bridged: Free islands that were joined to the rest by a line.
        filled: Holes that were filled.
    """

    contours: list[BaseGeometry]
    regions: list[BaseGeometry]
    dropped: tuple[PrintedPiece, ...]
    bridged: tuple[PrintedPiece, ...]
    filled: tuple[Hole, ...]


def require_island_area(pattern: Pattern, island_area: float) -> None:
    """Check that the area below which islands are removed is smaller than the pattern.

    Raises:
        ParameterError: Naming the area in m², and that of the pattern.
    """
    whole = float(pattern.areas.sum())
    if not (is_number(island_area) and (0 <= island_area < whole or math.isinf(island_area))):
        raise ParameterError(
            f"island_area = {shown(island_area)} m² must be at least 0 and below the pattern's "
            f"{whole:.3g} m²; 0 bridges all islands, math.inf removes all. 20 mm² are 20e-6."
        )


def clean(
    pattern: Pattern,
    regions: Sequence[BaseGeometry],
    limits: PrintLimits = DEFAULT_LIMITS,
    island_area: float = 0.0,
    smoothing: float | None = None,
) -> CleanedRegions:
    """Return regions that can be printed: no thin line or gap, no small hole, no free island.

    Args:
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
        limits: Limits of the printer.
        island_area: Free islands smaller than this are removed, in m²; larger ones are joined to
            the rest of their panel by a line, where one fits.
        smoothing: Length in m of `smoothed`, for contours on a mesh; None for polygons that are
            smooth.

    Raises:
        ParameterError: The area is negative.
    """
    if not (is_number(island_area) and island_area >= 0):
        raise ParameterError(
            f"island_area = {shown(island_area)} m² must be at least 0; 0 bridges all islands."
        )
    outlines = [pattern.outline(panel) for panel in range(len(pattern.panel_names))]
    made = [
        _cleaned(region, outline, limits, smoothing)
        for region, outline in zip(regions, outlines, strict=True)
    ]
    filled = tuple(h for h in find_holes(pattern, regions) if h.area < limits.hole_area)
    width = bridge_width(limits, smoothing)
    dropped, bridged = [], []
    islands = [p for p in find_pieces(pattern, made, limits.contact) if not p.attached]
    bridges: list[list[BaseGeometry]] = [[] for _ in made]
    for island in islands:  # the largest first
        line = None
        if island.area >= island_area:
            others = shapely.union_all([p.polygon for p in islands if p.panel == island.panel])
            rest = made[island.panel].difference(others.buffer(limits.resolution))
            rest = shapely.union_all([rest, *bridges[island.panel]])
            line = bridge(island.polygon, rest, outlines[island.panel], width)
        if line is None:
            dropped.append(island)
        else:
            bridged.append(island)
            bridges[island.panel] += [island.polygon, line]
    for panel in sorted({island.panel for island in islands}):
        gone = [p.polygon for p in dropped if p.panel == panel]
        left = made[panel].difference(shapely.union_all(gone).buffer(limits.resolution))
        made[panel] = left
        if bridges[panel]:
            joined = shapely.union_all([left, *bridges[panel]])
            made[panel] = _cleaned(joined, outlines[panel], limits, None)
    return CleanedRegions(list(regions), made, tuple(dropped), tuple(bridged), filled)


def clean_symmetric(
    part: Pattern,
    whole: Mirrored,
    regions: Sequence[BaseGeometry],
    limits: PrintLimits = DEFAULT_LIMITS,
    *,
    island_area: float = 0.0,
    smoothing: float | None = None,
) -> CleanedRegions:
    """Return regions of a symmetric skin that can be printed, exactly symmetric.

    Args:
        part: The part that is designed.
        whole: The whole, by `meshes.mirrored`.
        regions: Print on each panel of the whole, polygons in m.
        limits, island_area, smoothing: As of `clean`.

    Raises:
        ParameterError: The area is negative.
    """

    def even(made: CleanedRegions) -> list[BaseGeometry]:
        return symmetric_regions(part, whole, made.regions, limits.resolution)

    found = clean(whole.pattern, regions, limits, island_area, smoothing)
    made = even(found)
    if found.bridged:  # bridges get images, which may lie close to others
        made = even(clean(whole.pattern, made, limits, island_area))
    return replace(found, regions=made)


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


def bridge_width(limits: PrintLimits, smoothing: float | None) -> float:
    """Return the width in m of a line that joins an island; arguments as of `clean`."""
    return max(BRIDGE * limits.width, 0.0 if smoothing is None else SEEN * smoothing)


def bridge(
    island: BaseGeometry, rest: BaseGeometry, outline: BaseGeometry, width: float
) -> BaseGeometry | None:
    """Return a line from an island to the rest of its panel; None where the panel has no room.

    Args:
        island: A polygon in m.
        rest: Other print.
        outline: Outline of the panel.
        width: Width of the line in m.
    """
    if rest.is_empty:
        return None
    ends = shapely.get_coordinates(shapely.shortest_line(island, rest))
    way = ends[1] - ends[0]
    # Into both, so that it meets them over its whole width.
    way *= width / 2 / max(float(np.hypot(*way)), 1e-12)
    line = shapely.LineString([ends[0] - way, ends[1] + way])
    return line.buffer(width / 2) & outline if outline.covers(line) else None
