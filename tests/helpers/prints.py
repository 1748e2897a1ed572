"""Printed regions."""

from collections.abc import Callable

import numpy as np
import shapely
from shapely.geometry import Point, box
from shapely.geometry.base import BaseGeometry

from toros_fem.making.contours import printed_regions
from toros_fem.meshes import Pattern

MM = 1e-3
Density = Callable[[np.ndarray], np.ndarray]


def metres(shape: BaseGeometry) -> BaseGeometry:
    """A shape given in mm, in m."""
    return shapely.transform(shape, lambda points: points * MM)


def regions_of(pattern: Pattern, density: Density) -> list[BaseGeometry]:
    """The regions where a density, a function of the flat points, exceeds 0.5."""
    values = density(pattern.flat_points), density(pattern.centroids)
    return printed_regions(pattern, *values, 0.5)


def flawed_tube(pattern: Pattern, length: float) -> list[BaseGeometry]:
    """Ribs of 3 mm on a spine, with one flaw of each kind, on a tube with printed caps.

    A neck of 0.4 mm, a bar that leaves 0.45 mm to the next rib, a hole, an island between ribs.
    """
    ribs = [box(8, y, 55, y + 3) for y in np.arange(8, length - 8, 10)]
    body = shapely.union_all([box(29, 4, 33, length - 4), *ribs])
    bites = [Point(18, 9.5 + sign * 3.2).buffer(3, 64) for sign in (-1, 1)]
    body = body.difference(shapely.union_all([*bites, Point(45, 19.5).buffer(0.35, 64)]))
    bar = box(48, 11, 51, 17.55)
    island = Point(16, 14.5).buffer(1.2, 64)
    caps = np.ones(len(pattern.flat_points)), np.ones(len(pattern.panel))
    regions = printed_regions(pattern, *caps, 0.5)
    regions[pattern.panel_index("wall")] = metres(shapely.union_all([body, bar, island]))
    return regions


def worn_alike(
    region: BaseGeometry, panel: BaseGeometry, depth: float, seen: BaseGeometry | None = None
) -> bool:
    """Whether no line and no gap of a print parts or vanishes when worn, or swollen, by a depth.

    Of a print that goes on beyond its panel only what is seen counts.
    """
    seen = panel if seen is None else seen
    fabric = panel.difference(region).buffer(-1e-8).buffer(1e-8)
    return all(
        _pieces_and_holes(shape & seen) == _pieces_and_holes(shape.buffer(-depth) & seen)
        for shape in (region, fabric)
    )


def _pieces_and_holes(shape: BaseGeometry) -> tuple[int, int]:
    parts = [part for part in shapely.get_parts(shape) if not part.is_empty]
    return len(parts), sum(len(part.interiors) for part in parts)
