"""A tile's print in the endless sheet: islands, thinnest line and gap, and how it is cleaned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components
from shapely.affinity import affine_transform, translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.making.as_printed.as_printed import Cleaner
from toros_fem.making.print.cleaning import CleanedRegions, bridge, bridge_width
from toros_fem.making.print.islands import PrintedPiece, find_holes
from toros_fem.making.print.printability import PrintLimits
from toros_fem.making.print.smoothing import smoothed
from toros_fem.making.print.thickness import thickened
from toros_fem.making.print.widths import LocalWidth, measure_widths
from toros_fem.meshes.makers.tile import SYMMETRIES, Tile
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import edges_of, following

# Number of tiles along each side where lines and gaps are measured; one lies in the middle.
SIDE = 3
# Contours of neighbouring tiles meet within rounding; this is the grid to merge them on, relative
# to the tile.
SNAP = 1e-7


@dataclass(frozen=True, eq=False)
class TilePrintability:
    """Measured printability of a tile among its equals.

    Attributes:
        island_areas: Areas of the islands in m², the largest first, as of `island_areas`.
        smallest_width, smallest_gap: The thinnest line and gap; None without facing sides. Their
            ends are in m, in the tile in the middle of `SIDE` × `SIDE`.
        narrow_lines, narrow_gaps: Places in one tile where lines, or gaps, are thinner than the
            limit; one on the tile's border may be listed on both sides.
    """

    island_areas: Floats
    smallest_width: LocalWidth | None
    smallest_gap: LocalWidth | None
    narrow_lines: tuple[LocalWidth, ...]
    narrow_gaps: tuple[LocalWidth, ...]

    @property
    def clean(self) -> bool:
        """Whether there are no islands, and no lines or gaps under the limit."""
        return not (len(self.island_areas) or self.narrow_lines or self.narrow_gaps)

    def summary(self) -> dict[str, Any]:
        """Return all results as plain numbers; each key ends in its unit."""
        line, gap = self.smallest_width, self.smallest_gap
        return {
            "islands": len(self.island_areas),
            "island_areas_mm2": (1e6 * self.island_areas).tolist(),
            "smallest_width_mm": line and 1e3 * line.width,
            "smallest_gap_mm": gap and 1e3 * gap.width,
            "narrow_places": len(self.narrow_lines),
            "tight_places": len(self.narrow_gaps),
        }


def tile_printability(
    tile: Tile, region: BaseGeometry, printed: Bools, limits: PrintLimits
) -> TilePrintability:
    """Measure the printability of a tile among its equals.

    Lines and gaps are measured in the middle one of `SIDE` × `SIDE` tiles, so that they continue
    across its borders.

    Args:
        tile: The tile.
        region: Printed region of one tile, in m.
        printed: Whether each triangle is printed, (t,).
        limits: Narrower lines and gaps are listed.
    """
    sides = np.diagonal(tile.lattice)
    middle = (SIDE // 2) * sides
    # Widths in the middle of a place on the border are counted on either side, not on neither.
    window = shapely.box(*(middle - limits.resolution), *(middle + sides + limits.resolution))
    lines, gaps = measure_widths(
        repeated(region, tile, SIDE, SIDE),
        shapely.box(0, 0, *(SIDE * sides)),
        0,
        limits.width,
        limits.gap,
        limits.resolution,
        window,
    )
    return TilePrintability(
        island_areas(tile, printed), lines.smallest, gaps.smallest, lines.narrow, gaps.narrow
    )


def tile_cleaner(tile: Tile, symmetry: str) -> Cleaner:
    """Return what `making.print.clean` is for panels: lines and gaps go on across a tile's border.

    `SIDE` × `SIDE` tiles are cleaned, and the one in the middle is kept. Pieces that end inside
    are islands: they do not reach their own periodic images.

    Args:
        tile: The tile.
        symmetry: Symmetry that the print keeps exactly, as for `Tile.symmetry_maps`.
    """

    def cleaned(
        pattern: Pattern,
        regions: Sequence[BaseGeometry],
        limits: PrintLimits,
        island_area: float,
        smoothing: float | None,
    ) -> CleanedRegions:
        sides = np.diagonal(tile.lattice)
        sheet = shapely.box(0, 0, *(SIDE * sides))
        shift = SIDE // 2 * sides
        middle = shapely.box(*shift, *(shift + sides))

        def made(one: BaseGeometry, length: float | None) -> BaseGeometry:
            many = repeated(one, tile, SIDE, SIDE)
            many = many if length is None else smoothed(many, sheet, length)
            return thickened(many, sheet, limits.width, limits.gap, limits.hole_area)

        def everywhere(shape: BaseGeometry) -> BaseGeometry:
            steps = range(-SIDE, SIDE + 1)
            return shapely.union_all(
                [translate(shape, *(np.array(step) * sides)) for step in product(steps, repeat=2)]
            )

        def even(sheets: BaseGeometry) -> BaseGeometry:
            one = translate(sheets & middle, *-shift)
            return symmetric_region(one, sides, symmetry, limits.resolution)

        sheets = made(regions[0], smoothing)
        pieces = shapely.get_parts(sheets)
        loose = ~shapely.dwithin(sheet.boundary, pieces, limits.resolution)
        rest = shapely.union_all(pieces[~loose])
        width = bridge_width(limits, smoothing)
        dropped, bridged = [], []
        for island in pieces[loose & shapely.contains(middle, shapely.centroid(pieces))]:
            line = bridge(island, rest, sheet, width) if island.area >= island_area else None
            found = PrintedPiece(0, island, main=False, attached=False)
            if line is None:
                dropped.append(found)
                sheets = sheets.difference(everywhere(island.buffer(limits.resolution)))
            else:
                bridged.append(found)
                sheets = sheets.union(everywhere(line))
        filled = tuple(h for h in find_holes(pattern, regions) if h.area < limits.hole_area)
        one = even(sheets)
        if bridged:  # bridges get images, which may lie close to others
            one = even(made(one, None))
        return CleanedRegions(list(regions), [one], tuple(dropped), tuple(bridged), filled)

    return cleaned


def symmetric_region(
    region: BaseGeometry, sides: Floats, symmetry: str, detail: float
) -> BaseGeometry:
    """Return the region of a tile made exactly symmetric.

    It is that of a fundamental part of the tile, with what only one of the images has.

    Args:
        region: Region of one tile, in m, symmetric but for some pieces.
        sides: Sides of the tile, (2,), in m.
        symmetry: One of `SYMMETRIES`.
        detail: Narrower differences in m count as rounding.
    """
    operations, (x, y) = SYMMETRIES[symmetry], sides / 2

    def image(shape: BaseGeometry, operation: Ints) -> BaseGeometry:
        offset = sides / 2 - operation @ (sides / 2)
        return affine_transform(shape, [*operation.ravel(), *offset])

    for operation in operations[1:]:
        there = image(region, operation)
        more = there.difference(region).buffer(-detail / 2).buffer(detail)
        region = region.union(more & there)
    corners = {
        "none": [(0, 0), (2 * x, 0), (2 * x, 2 * y), (0, 2 * y)],
        "tetragonal": [(x, y), (2 * x, y), (2 * x, 2 * y)],
    }.get(symmetry, [(x, y), (2 * x, y), (2 * x, 2 * y), (x, 2 * y)])
    part = region & shapely.Polygon(corners)
    images = [image(part, operation) for operation in operations]
    return shapely.union_all(images, grid_size=SNAP * float(sides.max()))


def repeated(region: BaseGeometry, tile: Tile, along: int, across: int) -> BaseGeometry:
    """Return the union of copies of a tile's region.

    Args:
        region: Region of one tile, in m.
        tile: The tile.
        along, across: Numbers of copies along both lattice vectors.
    """
    size = float(np.abs(tile.lattice).max())
    copies = [
        translate(region, *(i * tile.lattice[0] + j * tile.lattice[1]))
        for i in range(along)
        for j in range(across)
    ]
    return shapely.union_all(copies, grid_size=SNAP * size)


def island_areas(tile: Tile, printed: Bools) -> Floats:
    """Return the areas in m² of the printed islands, the largest first.

    Printed triangles belong to one component if they share edges. A component that reaches its own
    image in a neighbouring tile is a line or a net through the whole sheet; any other is an island.

    Args:
        tile: The tile.
        printed: Whether each triangle is printed, (t,).
    """
    pattern = tile.pattern
    count = len(pattern.triangles)
    edges = edges_of(pattern.triangles)
    # Each triangle sees an edge's first end with wraps of its own; their difference is the step
    # from one triangle's frame to the other's.
    starts = pattern.triangles.ravel()[edges.twins]
    corner = np.where(starts == edges.ends[:, :1], edges.twins, following(edges.twins))
    seen = tile.wraps.reshape(-1, 2)[corner]
    (one, two), step = edges.sides.T, seen[:, 0] - seen[:, 1]
    both = printed[one] & printed[two]
    one, two, step = one[both], two[both], step[both]
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(count, count)).tocsr()
    number, label = connected_components(graph, directed=False)
    offset = np.zeros((count, 2), dtype=np.int64)
    steps = {}
    for k in range(len(one)):
        a, b = int(one[k]), int(two[k])
        steps[a, b], steps[b, a] = step[k], -step[k]
    first = np.unique(label, return_index=True)[1]
    connected = np.zeros(number, dtype=bool)
    for component in range(number):
        if not printed[first[component]]:
            continue
        cells, parent = breadth_first_order(graph, int(first[component]), directed=False)
        for cell in cells[1:].tolist():
            offset[cell] = offset[parent[cell]] + steps[int(parent[cell]), cell]
    # Two ways to one triangle that differ by a lattice vector join the component to its image.
    np.logical_or.at(connected, label[one], np.any(offset[two] - offset[one] != step, axis=1))
    areas = np.bincount(label, pattern.areas, minlength=number)
    return np.asarray(np.sort(areas[printed[first] & ~connected])[::-1])
