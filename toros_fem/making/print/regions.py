"""Polygons on the panels of another mesh, on a whole skin, and on the part that is designed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import PanelError
from toros_fem.meshes.affine import Affine
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import scaled_points

# Corners of regions that are joined across a cut lie on a grid of this fraction of the skin's size.
GRID = 1e-9


def regions_on(
    source: Pattern, regions: Sequence[BaseGeometry], target: Pattern
) -> list[BaseGeometry]:
    """Return polygons on the panels of another mesh of the same pattern.

    Where a panel has a slightly different size on it, the polygons are scaled.

    Args:
        source: The pattern that the polygons belong to.
        regions: Polygons on each of its panels, in m.
        target: The other mesh.

    Raises:
        PanelError: The panels are others, or the number of regions is not theirs.
    """
    if len(regions) != len(source.panel_names):
        raise PanelError(
            f"there are {len(regions)} regions for {len(source.panel_names)} panels; give one for "
            "each panel, an empty polygon where nothing is printed."
        )
    if sorted(source.panel_names) != sorted(target.panel_names):
        raise PanelError(
            f"the panels are named {list(source.panel_names)} and {list(target.panel_names)}; "
            "polygons can only be put on the same panels."
        )
    if source is target:
        return list(regions)
    there = scaled_points(source, target)
    found = []
    for name in target.panel_names:
        points = np.unique(target.flat_triangles[target.cells_of(name)])
        place = Affine.fit(there[points], target.flat_points[points])
        found.append(place.region(regions[source.panel_index(name)]))
    return found


def mirrored_regions(
    part: Pattern, whole: Mirrored, regions: Sequence[BaseGeometry]
) -> list[BaseGeometry]:
    """Return polygons on each panel of a whole skin from those on its part.

    Args:
        part: The part.
        whole: The whole, by `meshes.mirrored`.
        regions: Polygons on each panel of the part, in m.
    """
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


def part_regions(part: Pattern, regions: Sequence[BaseGeometry]) -> list[BaseGeometry]:
    """Return polygons on the panels of a part from those on the whole skin.

    Args:
        part: The part, whose panels are the first of the whole, at the same places.
        regions: Polygons on each panel of the whole, in m.
    """
    return [regions[k] & part.outline(k) for k in range(len(part.panel_names))]


def symmetric_part(
    part: Pattern, whole: Mirrored, regions: Sequence[BaseGeometry], detail: float
) -> list[BaseGeometry]:
    """Return polygons on the panels of a part such that the whole becomes exactly symmetric.

    They are those of the part, with what only one of its images has.

    Args:
        part: The part, whose panels are the first of the whole, at the same places.
        whole: The whole, by `meshes.mirrored`.
        regions: Polygons on each panel of the whole, in m, symmetric but for some pieces.
        detail: Narrower differences in m count as rounding.
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
