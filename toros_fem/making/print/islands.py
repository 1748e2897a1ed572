"""Printed pieces, islands and holes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Ints
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.triangles import linked

# Number of points on each pair of sewn edges where the print on both sides is looked up.
SEAM_POINTS = 32
# Borders closer than this fraction of the skin's size are the same.
TOUCHING = 1e-7
# Pieces whose areas differ by a smaller part are images of each other.
SAME_AREA = 1e-3


@dataclass(frozen=True, eq=False)
class PanelRegion:
    """A polygon in m on a panel, given by its number: a connected piece of print, or a hole in it.

    Attributes:
        main: Whether it is a main body, the largest piece of its panel. In a symmetric print there
            are several, the images of one. The others are islands.
        attached: Whether it is a main body, or is connected to one across seams. An island that is
            not attached is free.
    """

    panel: int
    polygon: BaseGeometry
    main: bool = False
    attached: bool = False

    @property
    def area(self) -> float:
        """Area in m²."""
        return float(self.polygon.area)


def find_pieces(pattern: Pattern, regions: Regions, contact: float = 0.0) -> list[PanelRegion]:
    """Return the printed pieces of all panels, the largest first.

    They are connected where they meet at seams along a length in m, the contact.
    """
    parts, panel = shapely.get_parts(list(regions), return_index=True)
    order = np.argsort(-shapely.area(parts), kind="stable")
    order = order[~shapely.is_empty(parts[order])]
    parts, panel = parts[order], panel[order]
    largest = np.zeros(len(regions))
    np.maximum.at(largest, panel, shapely.area(parts))
    main = shapely.area(parts) > (1 - SAME_AREA) * largest[panel]
    links = _across_seams(pattern, parts, panel, contact)
    body = linked(links[:, 0], links[:, 1], len(parts)) if len(parts) else panel
    attached = np.isin(body, body[main])
    return [
        PanelRegion(int(p), part, bool(m), bool(a))
        for p, part, m, a in zip(panel, parts, main, attached, strict=True)
    ]


def find_holes(pattern: Pattern, regions: Regions) -> tuple[PanelRegion, ...]:
    """Return the fabric that print encloses, islands in it included, the smallest hole first.

    Cut-outs of the panel are no holes.
    """
    holes = []
    for panel, region in enumerate(regions):
        border = pattern.outline(panel).boundary
        shapely.prepare(border)
        rings = [ring for part in shapely.get_parts(region) for ring in part.interiors]
        cut = shapely.dwithin(border, rings, TOUCHING * pattern.size)
        holes += [
            PanelRegion(panel, shapely.Polygon(ring))
            for ring, at_cut in zip(rings, cut, strict=True)
            if not at_cut
        ]
    return tuple(sorted(holes, key=lambda hole: hole.area))


def _across_seams(
    pattern: Pattern, parts: npt.NDArray[np.object_], panel: Ints, contact: float
) -> Ints:
    """Return pairs of parts, (k, 2), that meet over a length where edges are sewn together."""
    fraction = (np.arange(SEAM_POINTS) + 0.5)[:, None] / SEAM_POINTS
    sides = []
    for edge in np.moveaxis(pattern.seams, 1, 0):
        start, end = np.moveaxis(pattern.flat_points[edge], 1, 0)[:, :, None]
        points = shapely.points((1 - fraction) * start + fraction * end).ravel()
        near = TOUCHING * pattern.size
        part, at = shapely.STRtree(points).query(parts, predicate="dwithin", distance=near)
        own = panel[part] == np.repeat(pattern.panel_of_point[edge[:, 0]], SEAM_POINTS)[at]
        found = np.full(len(points), -1)
        found[at[own]] = part[own]
        sides.append(found)
    pairs = np.sort(np.stack(sides, axis=1), axis=1)
    met = pairs[:, 0] >= 0
    edge = pattern.flat_points[pattern.seams[:, 0]]
    step = np.repeat(np.linalg.norm(edge[:, 1] - edge[:, 0], axis=1) / SEAM_POINTS, SEAM_POINTS)
    found, which = np.unique(pairs[met], axis=0, return_inverse=True)
    return found[np.bincount(which.ravel(), step[met], minlength=len(found)) >= contact]
