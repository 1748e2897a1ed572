"""Flat regions and the triangles of a mesh, cut by each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.pattern import Pattern

Polygons: TypeAlias = npt.NDArray[np.object_]

# Corners of the pieces that a region is divided into before it is cut by triangles.
PIECE = 40
# A part that is smaller than this fraction of its triangle comes from rounding.
SLIVER = 1e-6


@dataclass(frozen=True, eq=False)
class CutTriangles:
    """Polygons, inside or outside of regions, that make up all triangles that the regions reach.

    Their corners are given by the triangle, so that they can be put on any shape of the skin.

    Attributes:
        cell: Triangle of each polygon, (k,).
        inside: Whether each polygon lies in the regions, (k,).
        areas: Area of each polygon in its flat panel, (k,), in m².
        weights: Barycentric coordinates of the corners of all rings, (n, 3); the first corner of a
            ring comes again as its last. Holes run the other way around than outer rings.
        polygon: Polygon of each ring, (r,), ascending; its outer ring comes first.
        first: Number of the first corner of each ring, and n, (r + 1,).
    """

    cell: Ints
    inside: Bools
    areas: Floats
    weights: Floats
    polygon: Ints
    first: Ints

    def corners(self, corners: Floats) -> Floats:
        """Return the corners of all rings, (n, d), from those of the triangles, (t, 3, d)."""
        cells = np.repeat(self.cell[self.polygon], np.diff(self.first))
        return np.asarray(np.einsum("nc,ncd->nd", self.weights, corners[cells]))

    def repeated(self, count: int, triangles: int) -> CutTriangles:
        """Return the polygons on several copies of a skin, one after the other.

        Args:
            count: Number of copies.
            triangles: Number of triangles of the skin.
        """
        copy = np.arange(count)[:, None]
        size, corners = len(self.cell), len(self.weights)
        return CutTriangles(
            cell=(self.cell + triangles * copy).ravel(),
            inside=np.tile(self.inside, count),
            areas=np.tile(self.areas, count),
            weights=np.tile(self.weights, (count, 1)),
            polygon=(self.polygon + size * copy).ravel(),
            first=np.append((self.first[:-1] + corners * copy).ravel(), count * corners),
        )


def cut_triangles(pattern: Pattern, regions: Sequence[BaseGeometry]) -> CutTriangles:
    """Cut the triangles of all panels by regions.

    Args:
        pattern: The pattern.
        regions: Region of each panel, polygons in m.
    """
    cells, flags, polygons = [], [], []
    for panel, region in enumerate(regions):
        here = np.flatnonzero(pattern.panel == panel)
        corners, areas = pattern.corners[here], pattern.areas[here]
        cell, parts = cut_by_triangles(region, corners)
        share = np.bincount(cell, shapely.area(parts), minlength=len(here)) / areas
        whole, cut = share >= 1 - SLIVER, (share > SLIVER) & (share < 1 - SLIVER)
        panel_area = shapely.coverage_union_all(shapely.polygons(corners))
        bare, rest = cut_by_triangles(panel_area.difference(region), corners[cut])
        for found, inside, some in (
            (here[whole], True, shapely.polygons(corners[whole])),
            (here[cell[cut[cell]]], True, parts[cut[cell]]),
            (here[cut][bare], False, rest),
        ):
            large = shapely.area(some) > SLIVER * pattern.areas[found]
            cells.append(found[large])
            flags.append(np.full(np.count_nonzero(large), inside))
            polygons.append(shapely.normalize(some[large]))
    cell, inside, parts = (np.concatenate(each) for each in (cells, flags, polygons))
    rings, polygon = shapely.get_rings(parts, return_index=True)
    first = np.concatenate([[0], np.cumsum(shapely.get_num_coordinates(rings))])
    points = shapely.get_coordinates(rings)
    a, b, c = np.moveaxis(pattern.corners[np.repeat(cell[polygon], np.diff(first))], 1, 0)
    area = _cross(b - a, c - a)
    second, third = _cross(points - a, c - a) / area, _cross(b - a, points - a) / area
    weights = np.stack([1 - second - third, second, third], axis=1)
    return CutTriangles(cell, inside, shapely.area(parts), weights, polygon, first)


def cut_by_triangles(region: BaseGeometry, corners: Floats) -> tuple[Ints, Polygons]:
    """Return the parts of a region that lie in triangles, as polygons that only share borders.

    Args:
        region: The region.
        corners: Corners of the triangles, (t, 3, 2).

    Returns:
        The triangle of each polygon, (k,), and the polygons, (k,).
    """
    triangles, pieces = shapely.polygons(corners), _divided(region)
    triangle, piece = shapely.STRtree(pieces).query(triangles, predicate="intersects")
    parts = shapely.intersection(triangles[triangle], pieces[piece])
    parts, origin = shapely.get_parts(parts, return_index=True)
    flat = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    return triangle[origin[flat]], parts[flat]


def _divided(region: BaseGeometry) -> Polygons:
    """Return pieces of a region with few corners each; they only share borders."""
    done: list[BaseGeometry] = []
    left = list(shapely.get_parts(region))
    while left:
        part = left.pop()
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        if shapely.get_num_coordinates(part) <= PIECE:
            done.append(part)
            continue
        x, y, right, top = part.bounds
        if right - x > top - y:
            middle = (x + right) / 2
            halves = (x, y, middle, top), (middle, y, right, top)
        else:
            middle = (y + top) / 2
            halves = (x, y, right, middle), (x, middle, right, top)
        for half in halves:
            left += list(shapely.get_parts(shapely.intersection(part, shapely.box(*half))))
    return np.array(done, dtype=object)


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
