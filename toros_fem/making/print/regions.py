"""Polygons on the panels of another mesh, on a whole skin, and on the part that is designed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.meshes.affine import Affine
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import scaled_points

# Corners of regions that are joined across a cut lie on a grid of this fraction of the skin's size.
GRID = 1e-9


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


def mirrored_regions(part: Pattern, whole: Mirrored, regions: Regions) -> list[BaseGeometry]:
    """Return the regions of a whole skin, by `meshes.mirrored`, from those of its part."""
    pieces: list[list[BaseGeometry]] = [[] for _ in whole.pattern.panel_names]
    for own, panel, place in _images(part, whole):
        pieces[panel].append(place.region(regions[own]))
    grid = GRID * whole.pattern.size
    return [p[0] if len(p) == 1 else shapely.union_all(p, grid_size=grid) for p in pieces]


def _images(part: Pattern, whole: Mirrored) -> Iterator[tuple[int, int, Affine]]:
    """Yield each panel of a part, its panel in each image, and the map to it."""
    count = len(part.panel)
    for image in range(len(whole.cell) // count):
        cells = slice(image * count, (image + 1) * count)
        corners, panels = whole.pattern.flat_triangles[cells], whole.pattern.panel[cells]
        for own in range(len(part.panel_names)):
            here = np.flatnonzero(part.panel[whole.cell[cells]] == own)
            points = np.unique(corners[here])
            source, target = part.flat_points[whole.flat[points]], whole.pattern.flat_points[points]
            yield own, int(panels[here[0]]), Affine.fit(source, target)


def part_regions(part: Pattern, regions: Regions) -> list[BaseGeometry]:
    """Return the regions of a part, whose panels are the first of the whole, at the same places."""
    return [regions[k] & part.outline(k) for k in range(len(part.panel_names))]


def symmetric_part(
    part: Pattern, whole: Mirrored, regions: Regions, detail: float
) -> list[BaseGeometry]:
    """Return regions of a part such that the whole becomes exactly symmetric.

    They are those of the part, with what only one of its images has; the whole's are symmetric but
    for some pieces. Differences narrower than the detail, in m, count as rounding.
    """
    own = part_regions(part, regions)
    for panel, image, place in _images(part, whole):
        there = place.inverse.region(regions[image])
        own[panel] = with_more(own[panel], there, part.outline(panel), detail)
    return own


def with_more(
    own: BaseGeometry, other: BaseGeometry, outline: BaseGeometry, detail: float
) -> BaseGeometry:
    """Return a region with what only its image has inside an outline, but for narrow pieces."""
    more = (other & outline).difference(own).buffer(-detail / 2).buffer(detail)
    return own if more.is_empty else own.union(more & other) & outline
