"""Printed pieces, islands and holes, and the removal of small ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Ints
from toros_fem.errors import ParameterError
from toros_fem.fabrication.contours import panel_outline
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.topology import linked

# Number of points on each pair of sewn edges where the print on both sides is looked up.
SEAM_POINTS = 32
# Borders closer than this fraction of the skin's size are the same.
TOUCHING = 1e-7


@dataclass(frozen=True, eq=False)
class PrintedPiece:
    """A connected printed region of one panel.

    Attributes:
        panel: Number of the panel.
        polygon: Its polygon, in m.
        main: Whether it is the main body, the largest piece of its panel. The others are islands.
        attached: Whether it is a main body, or is connected to one across seams. An island that is
            not attached is free.
    """

    panel: int
    polygon: BaseGeometry
    main: bool
    attached: bool

    @property
    def area(self) -> float:
        """Area in m²."""
        return float(self.polygon.area)


@dataclass(frozen=True, eq=False)
class Hole:
    """Fabric that print encloses.

    Attributes:
        panel: Number of the panel.
        polygon: The region inside its border, islands in it included, in m.
    """

    panel: int
    polygon: BaseGeometry

    @property
    def area(self) -> float:
        """Area in m²."""
        return float(self.polygon.area)


@dataclass(frozen=True, eq=False)
class CleanedRegions:
    """Printed regions without small islands and holes.

    Attributes:
        regions: Print on each panel, polygons in m.
        dropped: Free islands that were removed.
        filled: Holes that were filled.
    """

    regions: list[BaseGeometry]
    dropped: tuple[PrintedPiece, ...]
    filled: tuple[Hole, ...]


def find_pieces(pattern: Pattern, regions: Sequence[BaseGeometry]) -> list[PrintedPiece]:
    """Return the printed pieces of all panels, the largest first.

    Args:
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
    """
    parts, panel = shapely.get_parts(list(regions), return_index=True)
    order = np.argsort(-shapely.area(parts), kind="stable")
    order = order[~shapely.is_empty(parts[order])]
    parts, panel = parts[order], panel[order]
    main = np.zeros(len(parts), dtype=bool)
    main[np.unique(panel, return_index=True)[1]] = True
    links = _across_seams(pattern, parts, panel)
    body = linked(links[:, 0], links[:, 1], len(parts)) if len(parts) else panel
    attached = np.isin(body, body[main])
    return [
        PrintedPiece(int(p), part, bool(m), bool(a))
        for p, part, m, a in zip(panel, parts, main, attached, strict=True)
    ]


def find_holes(pattern: Pattern, regions: Sequence[BaseGeometry]) -> tuple[Hole, ...]:
    """Return the holes of the print, the smallest first; cut-outs of the panel are no holes."""
    holes = []
    for panel, region in enumerate(regions):
        border = panel_outline(pattern, panel).boundary
        shapely.prepare(border)
        rings = [ring for part in shapely.get_parts(region) for ring in part.interiors]
        cut = shapely.dwithin(border, rings, TOUCHING * pattern.size)
        holes += [
            Hole(panel, shapely.Polygon(ring))
            for ring, at_cut in zip(rings, cut, strict=True)
            if not at_cut
        ]
    return tuple(sorted(holes, key=lambda hole: hole.area))


def clean(
    pattern: Pattern, regions: Sequence[BaseGeometry], island_area: float, hole_area: float
) -> CleanedRegions:
    """Remove small free islands, then fill small holes.

    Args:
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
        island_area: Free islands smaller than this are removed, in m²; infinity removes all.
        hole_area: Holes smaller than this are filled, in m².

    Raises:
        ParameterError: An area is negative.
    """
    for name, area in (("island_area", island_area), ("hole_area", hole_area)):
        if not area >= 0:
            raise ParameterError(f"{name} = {area} m² must be at least 0; 0 keeps all.")
    pieces = find_pieces(pattern, regions)
    dropped = tuple(p for p in pieces if not p.attached and p.area < island_area)
    kept: list[list[BaseGeometry]] = [[] for _ in regions]
    for piece in pieces:
        if piece not in dropped:
            kept[piece.panel].append(piece.polygon)
    cleaned = [shapely.MultiPolygon(parts) for parts in kept]
    filled = tuple(hole for hole in find_holes(pattern, cleaned) if hole.area < hole_area)
    for panel in sorted({hole.panel for hole in filled}):
        plugs = [hole.polygon for hole in filled if hole.panel == panel]
        cleaned[panel] = shapely.union_all([cleaned[panel], *plugs])
    return CleanedRegions(cleaned, dropped, filled)


def _across_seams(
    pattern: Pattern, parts: npt.NDArray[np.object_], panel: Ints
) -> npt.NDArray[np.int64]:
    """Return pairs of parts, (k, 2), that meet where two edges are sewn together."""
    fraction = (np.arange(SEAM_POINTS) + 0.5)[:, None] / SEAM_POINTS
    of_point = np.zeros(len(pattern.flat_points), dtype=np.int64)
    of_point[pattern.flat_triangles] = pattern.panel[:, None]
    reach = TOUCHING * pattern.size
    shapely.prepare(parts)
    boxes = shapely.box(*(shapely.bounds(parts) + [-reach, -reach, reach, reach]).T)
    sides = []
    for edge in np.moveaxis(pattern.seams, 1, 0):
        start, end = np.moveaxis(pattern.flat_points[edge], 1, 0)[:, :, None]
        points = shapely.points((1 - fraction) * start + fraction * end).ravel()
        of_edge = np.repeat(of_point[edge[:, 0]], SEAM_POINTS)
        found = np.full(len(points), -1)
        for number in np.unique(panel):
            here, mine = np.flatnonzero(of_edge == number), np.flatnonzero(panel == number)
            # A prepared part has an index of its border; the tree alone would prepare the points.
            which, at = shapely.STRtree(points[here]).query(boxes[mine])
            near = shapely.dwithin(parts[mine[which]], points[here[at]], reach)
            found[here[at[near]]] = mine[which[near]]
        sides.append(found)
    pairs = np.stack(sides, axis=1)
    return pairs[(pairs >= 0).all(axis=1)]
