"""Prints whose lines are wider or narrower than drawn."""

from __future__ import annotations

from collections.abc import Sequence

import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.making.print.contours import panel_outline
from toros_fem.making.print.widths import fabric_of
from toros_fem.meshes.pattern import Pattern


def offset_print(
    pattern: Pattern, regions: Sequence[BaseGeometry], offset: float, resolution: float
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
        outline = panel_outline(pattern, panel)
        if offset >= 0:
            found.append(region.buffer(offset) & outline)
        else:
            found.append(region.difference(fabric_of(region, outline, resolution).buffer(-offset)))
    return found


def broken_lines(
    pattern: Pattern,
    drawn: Sequence[BaseGeometry],
    made: Sequence[BaseGeometry],
    resolution: float,
) -> list[str]:
    """Return what vanishes, parts or merges between a print as drawn and as made, as sentences.

    Args:
        pattern: The pattern.
        drawn, made: Print on each panel, polygons in m.
        resolution: Distance of samples in m, as of `PrintLimits`.
    """
    lines, gaps = [0, 0, 0], [0, 0, 0]
    for panel, (one, two) in enumerate(zip(drawn, made, strict=True)):
        outline = panel_outline(pattern, panel)
        _count(one, two, lines)
        fabric = [fabric_of(region, outline, resolution) for region in (one, two)]
        _count(fabric[0], fabric[1], gaps)
    # A ring of print that opens joins the fabric inside to that around it, and the reverse.
    events = {
        "line vanishes": lines[0],
        "line parts": lines[1] + gaps[2],
        "gap closes": gaps[0],
        "line touches another": gaps[1] + lines[2],
    }
    plural = {
        "line vanishes": "lines vanish",
        "line parts": "lines part",
        "gap closes": "gaps close",
        "line touches another": "lines touch others",
    }
    return [f"{n} {text if n == 1 else plural[text]}." for text, n in events.items() if n]


def _count(before: BaseGeometry, after: BaseGeometry, events: list[int]) -> None:
    """Add the numbers of pieces that vanish, that part and that merge."""
    one, two = (shapely.get_parts(shape) for shape in (before, after))
    one, two = (parts[shapely.area(parts) > 0] for parts in (one, two))
    if not len(one) or not len(two):
        events[0] += len(one)
        return
    pairs = shapely.STRtree(two).query(one, predicate="intersects")
    shares = shapely.area(shapely.intersection(one[pairs[0]], two[pairs[1]])) > 0
    here, there = pairs[:, shares]
    events[0] += len(set(range(len(one))) - set(here.tolist()))
    events[1] += len(here) - len(set(here.tolist()))
    events[2] += len(there) - len(set(there.tolist()))
