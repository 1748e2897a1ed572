"""Polygons on the panels of another mesh, on a whole skin, and on the part that is designed."""

from __future__ import annotations

import numpy as np
from shapely.geometry.base import BaseGeometry

from toros_fem.meshes.affine import Affine
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import scaled_points


def regions_on(
    source: Pattern, regions: Regions, target: Pattern, *, any_size: bool = False
) -> list[BaseGeometry]:
    """Return regions on another mesh of the same pattern, scaled where it has another size.

    Raises:
        PanelError: The panels are others, or the number of regions is not theirs.
    """
    source.require_regions(regions)
    if source is target:
        return list(regions)
    there = scaled_points(source, target, any_size=any_size)
    found = []
    for name in target.panel_names:
        points = np.unique(target.flat_triangles[target.cells_of(name)])
        place = Affine.fit(there[points], target.flat_points[points])
        found.append(place.region(regions[source.panel_index(name)]))
    return found


def part_regions(part: Pattern, regions: Regions) -> list[BaseGeometry]:
    """Return the regions of a part, whose panels are the first of the whole, at the same places."""
    return [regions[k] & part.outline(k) for k in range(len(part.panel_names))]


def with_more(
    own: BaseGeometry, other: BaseGeometry, outline: BaseGeometry, detail: float
) -> BaseGeometry:
    """Return a region with what only its image has inside an outline, but for narrow pieces."""
    more = (other & outline).difference(own).buffer(-detail / 2).buffer(detail)
    return own if more.is_empty else own.union(more & other) & outline
