"""A tile's print in the endless sheet: islands, thinnest line and gap, and its cleaning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, override

import numpy as np
import shapely
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.making.cleaning import Panels
from toros_fem.making.contours import Widths, measure_widths
from toros_fem.making.printability import PanelRegion, PrintLimits, with_more
from toros_fem.meshes.panels import Affine
from toros_fem.meshes.tiles import SYMMETRIES, Tile
from toros_fem.meshes.triangles import edges_of, following, linked

# Number of tiles along each side where lines and gaps are measured; one lies in the middle.
SIDE = 3
# Contours of neighbouring tiles meet within rounding; this is the grid to merge them on, relative
# to the tile.
SNAP = 1e-7


@dataclass(frozen=True, eq=False)
class TilePrintability:
    """Islands of a tile among its equals, in m², and its widths.

    A narrow place on the tile's border may be listed on both sides.
    """

    island_areas: Floats
    lines: Widths
    gaps: Widths

    @property
    def clean(self) -> bool:
        """Whether there are no islands, and no lines or gaps under the limit."""
        return not (len(self.island_areas) or self.narrow_places)

    @property
    def narrow_places(self) -> int:
        """Number of places where lines or gaps are under the limit."""
        return len(self.lines.narrow) + len(self.gaps.narrow)

    def summary(self) -> dict[str, Any]:
        """Return all results as plain numbers; each key ends in its unit."""
        line, gap = self.lines.smallest, self.gaps.smallest
        return {
            "islands": len(self.island_areas),
            "island_areas_mm2": (1e6 * self.island_areas).tolist(),
            "smallest_width_mm": line and 1e3 * line.width,
            "smallest_gap_mm": gap and 1e3 * gap.width,
            "narrow_places": len(self.lines.narrow),
            "tight_places": len(self.gaps.narrow),
        }


def tile_printability(
    tile: Tile, region: BaseGeometry, printed: Bools, limits: PrintLimits
) -> TilePrintability:
    """Measure the printability of a tile, its printed region in m and triangles (t,).

    Lines and gaps are measured in the middle one of `SIDE` × `SIDE` tiles: they continue.
    """
    sides, detail = np.diagonal(tile.lattice), limits.resolution
    middle = (SIDE // 2) * sides
    # Widths in the middle of a place on the border are counted on either side, not on neither.
    window = shapely.box(*(middle - detail), *(middle + sides + detail))
    many, sheet = repeated(region, tile, SIDE, SIDE), shapely.box(0, 0, *(SIDE * sides))
    widths = measure_widths(many, sheet, 0, limits.width, limits.gap, detail, window)
    return TilePrintability(island_areas(tile, printed), *widths)


class RepeatedTile(Panels):
    """`SIDE` × `SIDE` tiles, which are cleaned together, and of which the middle one is kept.

    Lines and gaps so go on across a tile's border. Pieces that end inside are islands: they do not
    reach their own images.

    Args:
        symmetry: Symmetry that the print keeps exactly, as for `Tile.symmetry_maps`.
    """

    repeats, sewn = True, False

    def __init__(self, tile: Tile, symmetry: str) -> None:
        self.pattern, self._tile = tile.pattern, tile
        self._sides = sides = np.diagonal(tile.lattice)
        self._operations = SYMMETRIES[symmetry]
        # Its images are the tile: all of it, a quarter, or an eighth.
        self.parts = [shapely.box(*(0 * sides if symmetry == "none" else sides / 2), *sides)]
        if symmetry == "tetragonal":
            self.parts = [shapely.Polygon([sides / 2, sides * [1, 0.5], sides])]
        self.outlines = [shapely.box(0, 0, *(SIDE * sides))]

    @override
    def laid(self, regions: Sequence[BaseGeometry]) -> list[BaseGeometry]:
        return [repeated(region, self._tile, SIDE, SIDE) for region in regions]

    @override
    def islands(self, laid: Sequence[BaseGeometry], limits: PrintLimits) -> list[PanelRegion]:
        pieces = shapely.get_parts(laid[0])
        loose = ~shapely.dwithin(self.outlines[0].boundary, pieces, limits.resolution)
        # Centroids of images differ by rounding; of those on two borders of the tile one counts.
        places = shapely.get_coordinates(shapely.centroid(pieces)) + limits.resolution
        home = np.all(places // self._sides == SIDE // 2, axis=1)
        chosen = pieces[loose & home]
        order = np.argsort(-shapely.area(chosen), kind="stable")
        return [PanelRegion(0, piece, main=False, attached=False) for piece in chosen[order]]

    @override
    def images(self, shape: BaseGeometry) -> BaseGeometry:
        most = 2 * SIDE - 1
        steps = self._sides * (_steps(most, most) + 1 - SIDE)
        return shapely.union_all([translate(shape, *step) for step in steps])

    @override
    def part(self, laid: Sequence[BaseGeometry], detail: float) -> list[BaseGeometry]:
        shift = SIDE // 2 * self._sides
        one = translate(laid[0], *-shift) & shapely.box(0, 0, *self._sides)
        (kept,) = self.parts
        own = one & kept
        for operation in self._operations[1:]:
            own = with_more(own, self._image(one, operation), kept, detail)
        return [own]

    @override
    def whole(self, own: Sequence[BaseGeometry]) -> list[BaseGeometry]:
        images = [self._image(own[0], operation) for operation in self._operations]
        return [shapely.union_all(images, grid_size=SNAP * float(self._sides.max()))]

    def _image(self, shape: BaseGeometry, operation: Ints) -> BaseGeometry:
        """Return a shape turned or mirrored about the tile's middle."""
        offset = self._sides / 2 - operation @ (self._sides / 2)
        return Affine(operation.astype(np.float64), offset).region(shape)


def _steps(along: int, across: int) -> Ints:
    return np.array(list(np.ndindex(along, across)))


def repeated(region: BaseGeometry, tile: Tile, along: int, across: int) -> BaseGeometry:
    """Return the union of copies of a tile's region in m along both lattice vectors."""
    copies = [translate(region, *(steps @ tile.lattice)) for steps in _steps(along, across)]
    return shapely.union_all(copies, grid_size=SNAP * float(np.abs(tile.lattice).max()))


def island_areas(tile: Tile, printed: Bools) -> Floats:
    """Return the areas in m² of the islands of printed triangles (t,), the largest first.

    Printed triangles belong to one component if they share edges. A component that reaches its own
    image in a neighbouring tile is a line or a net through the whole sheet; any other is an island.
    A line leads from a triangle to an image of it an odd number of tiles away along x or y. So the
    copies of a triangle on the torus of 2 × 2 tiles belong to one component on a line, and to four
    on an island.
    """
    count = len(printed)
    one, two = edges_of(tile.pattern.triangles).twins.T
    # The half-edge that follows the second of twins begins where the first does.
    shift = tile.wraps.reshape(-1, 2)[one] - tile.wraps.reshape(-1, 2)[following(two)]
    both = printed[one // 3] & printed[two // 3]
    one, two, shift = one[both] // 3, two[both] // 3, shift[both]
    home = _steps(2, 2)[:, None]
    there = (home + shift) % 2 @ [2, 1]
    body = linked(
        (one + count * np.arange(4)[:, None]).ravel(), (two + count * there).ravel(), 4 * count
    ).reshape(4, count)
    island = printed & (body[1:] != body[0]).all(axis=0)
    areas = np.bincount(body.min(axis=0)[island], tile.pattern.areas[island])
    return np.asarray(np.sort(areas[areas > 0])[::-1], dtype=np.float64)
