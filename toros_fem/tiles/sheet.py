"""A printed tile on a mesh of another edge length, and many of them as a sheet to print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem._mpi import on_first_rank
from toros_fem._types import Bools, Floats, Ints
from toros_fem._validate import require_between
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.tile import Tile, tile
from toros_fem.tiles.printed_tile import PrintedTile

# Corners of triangles nearer than this to a straight line of the print, in m, are no corners of it.
STRAIGHT = 1e-9
# A triangle counts as printed from half its area on: ties of symmetric triangles are all printed.
HALF = 0.5 - 1e-6


@dataclass(frozen=True, eq=False)
class TileSheet:
    """An open sheet of tiles, to be pulled along x or y.

    Attributes:
        name: Of the direction, "x" or "y".
        pattern: Its mesh, [0, a · columns] × [0, b · rows].
        cell: Triangle of the tile that each of its triangles copies, (t,).
    """

    name: str
    pattern: Pattern
    cell: Ints

    @property
    def axis(self) -> int:
        """0 along x, 1 along y."""
        return "xy".index(self.name)


def sheet_of(made: Tile, name: str, along: int, across: int) -> TileSheet:
    """A sheet of so many tiles along the direction it is pulled in, and across.

    Args:
        made: The tile.
        name: Of the direction, "x" or "y".
        along, across: Numbers of tiles.

    Raises:
        ParameterError: A number is not whole, or less than 1.
    """
    counts = (along, across) if name == "x" else (across, along)
    return TileSheet(name, *made.sheet(*counts))


def region_of_triangles(triangles: Floats) -> BaseGeometry:
    """The region of triangles (t, 3, 2) of one mesh, joined where they share an edge."""
    return shapely.simplify(shapely.coverage_union_all(shapely.polygons(triangles)), STRAIGHT)


def resampled(comm: MPI.Comm, made: PrintedTile, edge_length: float) -> PrintedTile:
    """The same print on a mesh of another edge length: printed is what is so by half (collective).

    Args:
        comm: Communicator.
        made: The tile.
        edge_length: Wanted in m.

    Raises:
        ParameterError: The length is not positive, or too large for the tile.
        DensityError: The tile does not fit its own mesh.
    """
    old = made.tile(comm)
    new = tile(comm, made.size, edge_length, made.mesh, made.symmetry)

    def sample() -> Bools:
        region = region_of_triangles(old.pattern.corners[made.printed])
        shapely.prepare(region)
        triangles = shapely.polygons(new.pattern.corners)
        printed = shapely.contains(region, triangles)
        cut = shapely.intersects(region, triangles) & ~printed
        share = shapely.area(shapely.intersection(region, triangles[cut])) / new.pattern.areas[cut]
        printed[cut] = share >= HALF
        return np.asarray(printed)

    return replace(made, printed=on_first_rank(comm, sample), edge_length=edge_length)


def print_layout(
    sheets: Sequence[TileSheet], printed: Bools, margin: float
) -> tuple[Pattern, list[BaseGeometry]]:
    """The cloth of sheets with margins to clamp, and what is printed on it.

    Args:
        sheets: Sheets of the tile, on the mesh that it is printed from.
        printed: Whether each of the tile's triangles is printed, (t,).
        margin: Length in m by which the cloth is longer than the print, at both ends.

    Returns:
        A pattern with a panel for each sheet, and the region printed on each, in m. Tiles share
        the vertices of their borders, so that the print is of one piece across them.

    Raises:
        ParameterError: The margin is negative or not finite.
    """
    require_between(0.0, np.inf, margin=margin)
    corners, regions = [], []
    for sheet in sheets:
        spare = np.where(np.arange(2) == sheet.axis, margin, 0.0)
        size = sheet.pattern.flat_points.max(axis=0) + 2 * spare
        corners.append(size * [[0, 0], [1, 0], [1, 1], [0, 1]])
        region = region_of_triangles(sheet.pattern.corners[printed[sheet.cell]])
        regions.append(translate(region, *spare))
    count = len(sheets)
    flat = np.concatenate(corners)
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    cloth = Pattern(
        flat_points=flat,
        flat_triangles=np.concatenate([4 * k + halves for k in range(count)]),
        panel=np.repeat(np.arange(count), 2),
        sewn=np.arange(len(flat)),
        points=np.column_stack([flat, np.repeat(np.arange(float(count)), 4)]),
        panel_names=tuple(f"along_{sheet.name}" for sheet in sheets),
    )
    return cloth, regions
