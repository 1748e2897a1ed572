"""Prints whose lines are wider or narrower than drawn."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Ints
from toros_fem.making.print.polygons import fabric_of
from toros_fem.meshes.pattern import Pattern, Regions


def offset_print(
    pattern: Pattern, regions: Regions, offset: float, resolution: float
) -> list[BaseGeometry]:
    """Return a print whose borders have moved outwards; the panel's border is none of them.

    Args:
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
        offset: Way of each border in m, below 0 inwards: a line gets wider by twice as much.
        resolution: Distance of samples in m, as of `PrintLimits`.
    """
    found = []
    for panel, region in enumerate(regions):
        outline = pattern.outline(panel)
        if offset >= 0:
            found.append(region.buffer(offset) & outline)
        else:
            found.append(region.difference(fabric_of(region, outline, resolution).buffer(-offset)))
    return found


def broken_lines(
    pattern: Pattern,
    drawn: Regions,
    made: Regions,
    resolution: float,
) -> list[str]:
    """Return what vanishes, parts or merges between a print as drawn and as made, as sentences."""
    lines: Ints = np.zeros(3, dtype=np.int64)
    gaps: Ints = np.zeros(3, dtype=np.int64)
    for panel, (one, two) in enumerate(zip(drawn, made, strict=True)):
        outline = pattern.outline(panel)
        lines += _events(one, two)
        gaps += _events(*(fabric_of(region, outline, resolution) for region in (one, two)))
    # A ring of print that opens joins the fabric inside to that around it, and the reverse.
    events = (
        (lines[0], "line vanishes", "lines vanish"),
        (lines[1] + gaps[2], "line parts", "lines part"),
        (gaps[0], "gap closes", "gaps close"),
        (gaps[1] + lines[2], "line touches another", "lines touch others"),
    )
    return [f"{n} {one if n == 1 else several}." for n, one, several in events if n]


def _events(before: BaseGeometry, after: BaseGeometry) -> Ints:
    """Return the numbers of pieces that vanish, that part and that merge, (3,)."""
    one, two = (shapely.get_parts(shape) for shape in (before, after))
    one, two = (parts[shapely.area(parts) > 0] for parts in (one, two))
    pairs = shapely.STRtree(two).query(one, predicate="intersects")
    shares = shapely.area(shapely.intersection(one[pairs[0]], two[pairs[1]])) > 0
    here, there = (np.unique(own) for own in pairs[:, shares])
    count = int(shares.sum())
    return np.array([len(one) - len(here), count - len(here), count - len(there)])
