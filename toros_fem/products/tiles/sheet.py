"""Sheets of printed tiles: on a mesh of another edge length, and as a layout to print."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import require_between, require_choice
from toros_fem.meshes.makers.tile import Tile, tile
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tiles.printability import repeated
from toros_fem.products.tiles.printed_tile import PrintedTile

DIRECTIONS = ("x", "y")
# Corners of triangles closer than this to a straight border of the print, in m, are left out.
COLLINEAR = 1e-9
# A triangle is printed if at least half its area is. The margin is for rounding: of triangles that
# a symmetry maps to each other all are printed, or none.
HALF = 0.5 - 1e-6
# Least size of a swatch, and its unprinted cloth at both ends for clamps, in m.
SWATCH, CLAMPED = 50e-3, 20e-3


@dataclass(frozen=True, eq=False)
class TileSheet:
    """An open sheet of tiles that is pulled along x or y.

    Attributes:
        direction: Direction of the pull, "x" or "y".
        pattern: Mesh of the sheet, [0, a · columns] × [0, b · rows].
        cell: Triangle of the tile that each triangle of the sheet copies, (t,).
    """

    direction: str
    pattern: Pattern
    cell: Ints

    @property
    def axis(self) -> int:
        """Axis of the pull: 0 for x, 1 for y."""
        return DIRECTIONS.index(self.direction)


def tile_sheet(tile: Tile, direction: str, along: int, across: int) -> TileSheet:
    """Return a sheet of so many tiles along the direction of the pull, "x" or "y", and across.

    Raises:
        ParameterError: The direction is unknown, or a number is not whole or less than 1.
    """
    require_choice("direction", direction, DIRECTIONS)
    counts = (along, across) if direction == "x" else (across, along)
    return TileSheet(direction, *tile.sheet(*counts))


def region_of_triangles(triangles: Floats) -> BaseGeometry:
    """Return the union of triangles (t, 3, 2) of one mesh."""
    return shapely.simplify(shapely.coverage_union_all(shapely.polygons(triangles)), COLLINEAR)


def remesh(comm: MPI.Comm, printed_tile: PrintedTile, edge_length: float) -> PrintedTile:
    """Return the same print on a mesh of another edge length in m (collective).

    A triangle of the new mesh is printed if at least half its area is.

    Raises:
        ParameterError: The length is not positive, or too large for the tile.
        DensityError: The print does not fit its own mesh.
    """
    old = printed_tile.tile(comm)
    new = tile(comm, printed_tile.size, edge_length, printed_tile.mesh, printed_tile.symmetry)

    def sample() -> Bools:
        region = region_of_triangles(old.pattern.corners[printed_tile.printed])
        shapely.prepare(region)
        triangles = shapely.polygons(new.pattern.corners)
        printed = shapely.contains(region, triangles)
        cut = shapely.intersects(region, triangles) & ~printed
        areas = shapely.area(shapely.intersection(region, triangles[cut]))
        printed[cut] = areas / new.pattern.areas[cut] >= HALF
        return np.asarray(printed)

    return replace(printed_tile, printed=on_first_rank(comm, sample), edge_length=edge_length)


def swatch(tile: Tile, region: BaseGeometry, printed: Bools) -> tuple[Pattern, BaseGeometry]:
    """Return the cloth of a piece of tiles, at least 5 cm wide each way, and the print on it.

    The print of one tile is given as polygons in m and as triangles (t,).
    """
    along, across = (math.ceil(SWATCH / side - 1e-9) for side in np.diagonal(tile.lattice))
    cloth, _ = print_layout([tile_sheet(tile, "x", along, across)], printed, CLAMPED)
    return cloth, translate(repeated(region, tile, along, across), CLAMPED, 0.0)


def print_layout(
    sheets: Sequence[TileSheet], printed: Bools, margin: float
) -> tuple[Pattern, list[BaseGeometry]]:
    """Return the cloth of sheets with margins for the clamps, and the print on it.

    Args:
        sheets: Sheets of the tile, on the mesh that it is printed from.
        printed: Whether each of the tile's triangles is printed, (t,).
        margin: Length in m of unprinted cloth at both ends of each sheet.

    Returns:
        A pattern with one panel for each sheet, and the printed region of each panel, in m. Tiles
        share the vertices of their borders, so that the print is continuous across them.

    Raises:
        ParameterError: The margin is negative or not finite.
    """
    require_between(0.0, np.inf, margin=margin)
    corners, regions = [], []
    for sheet in sheets:
        offset = np.where(np.arange(2) == sheet.axis, margin, 0.0)
        size = sheet.pattern.flat_points.max(axis=0) + 2 * offset
        corners.append(size * [[0, 0], [1, 0], [1, 1], [0, 1]])
        region = region_of_triangles(sheet.pattern.corners[printed[sheet.cell]])
        regions.append(translate(region, *offset))
    flat, panel = np.concatenate(corners), np.arange(len(sheets))
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    cloth = Pattern(
        flat_points=flat,
        flat_triangles=(4 * panel[:, None, None] + halves).reshape(-1, 3),
        panel=np.repeat(panel, 2),
        sewn=np.arange(len(flat)),
        points=np.column_stack([flat, np.repeat(panel.astype(float), 4)]),
        panel_names=tuple(f"along_{sheet.direction}" for sheet in sheets),
    )
    return cloth, regions
