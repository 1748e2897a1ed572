"""A printed tile: its print, mesh, materials and file, and the sheets that it makes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.array_types import Bools, Ints
from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    checked_path,
    require_between,
    require_choice,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.making.print.print_file import packed_regions, regions_of
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.makers.tile import Tile, tile
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tiles.printability import repeated

NAME, KIND = "tile.npz", "tile"
MEMBRANE = Composite(bending=None)
DIRECTIONS = ("x", "y")
# Corners of a print closer than this to a straight border of it, in m, are left out.
COLLINEAR = 1e-9
# Edges along the shorter side of the plain tile that is meshed along the print.
PLAIN = 4
# Least size of a swatch, and its unprinted cloth at both ends for clamps, in m.
SWATCH, CLAMPED = 50e-3, 20e-3


@dataclass(frozen=True, eq=False)
class PrintedTile:
    """A tile and the print on it.

    Attributes:
        region: Printed polygons in the tile [0, a] × [0, b], in m.
        size: Its sides (a, b) in m.
        edge_length: Edge length in m of its mesh outside of the print.
        composite: Its materials, as a membrane without a bladder.

    Raises:
        ParameterError: The region is no shape, a number is outside its range, or the composite
            bends, has a bladder, or a knit whose grain is given by panels.
    """

    region: BaseGeometry
    size: tuple[float, float]
    edge_length: float
    composite: Composite = MEMBRANE

    def __post_init__(self) -> None:
        require_kind("region", self.region, BaseGeometry, "polygons in m, by shapely")
        if not isinstance(self.size, list | tuple) or len(self.size) != 2:
            raise ParameterError(f"size = {shown(self.size)} must be two sides (a, b) in m.")
        require_kind("composite", self.composite, Composite, "a Composite")
        require_positive(size_x=self.size[0], size_y=self.size[1], edge_length=self.edge_length)
        if self.composite.bending is not None or self.composite.bladder is not None:
            raise ParameterError(
                "a printed tile is a membrane: its composite must have bending = None and "
                "bladder = None."
            )
        knit = self.composite.knit
        if knit is not None and not isinstance(knit.grain, float):
            raise ParameterError(
                "a printed tile is one panel: the grain of its knit must be one angle."
            )

    @property
    def share(self) -> float:
        """Printed part of its area."""
        return float(self.region.area / np.prod(self.size))

    def tile(self, comm: MPI.Comm) -> tuple[Tile, Bools]:
        """Return the tile, meshed along the print, and whether each triangle is printed, (t,).

        Raises:
            PatternError: Borders of the print meet each other.
            MeshSizeError: There would be too many triangles.
        """
        plain = tile(comm, self.size, min(self.size) / PLAIN)
        return plain.following(comm, self.region, self.edge_length)


def write_tile(folder: str | Path, printed_tile: PrintedTile) -> None:
    """Write a printed tile as the archive `tile.npz` into a folder (one rank)."""
    require_kind("printed_tile", printed_tile, PrintedTile, "a PrintedTile")
    folder, numbers = checked_path("folder", folder), dict(vars(printed_tile))
    region = numbers.pop("region")
    numbers["composite"] = printed_tile.composite.as_dict()
    write_archive(folder / NAME, Archive(KIND, packed_regions([region]), numbers))


@on_root
def read_tile(comm: MPI.Comm, folder: str | Path) -> PrintedTile:
    """Read the printed tile that `write_tile` wrote into a folder (collective).

    Raises:
        FileError: There is no such file, it is damaged, or holds no valid tile.
    """
    path = checked_path("folder", folder, FileError) / NAME

    def make(archive: Archive) -> PrintedTile:
        if "printed" in archive.arrays:
            raise FileError("an older version wrote it: it holds triangles, no polygons")
        numbers = dict(archive.numbers)
        composite = Composite.of_dict(numbers.pop("composite"))
        size = tuple(numbers.pop("size"))
        (region,) = regions_of(archive, 1)
        return PrintedTile(region, size, composite=composite, **numbers)

    remedy = "Give the output folder of demos/tile.py."
    return read_archive(path, KIND, make, FileError, remedy)


@dataclass(frozen=True, eq=False)
class TileSheet:
    """An open sheet of tiles that is pulled along x or y.

    Attributes:
        direction: Direction of the pull, "x" or "y".
        tile: The tile.
        counts: Numbers of tiles along x and y.
        pattern: Mesh of the sheet, [0, a · columns] × [0, b · rows].
        cell: Triangle of the tile that each triangle of the sheet copies, (t,).
    """

    direction: str
    tile: Tile
    counts: tuple[int, int]
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
    return TileSheet(direction, tile, counts, *tile.sheet(*counts))


def swatch(tile: Tile, region: BaseGeometry) -> tuple[Pattern, BaseGeometry]:
    """Return the cloth of a piece of tiles, at least 5 cm wide each way, and the print on it.

    The region is that of one tile, in m.
    """
    counts = (math.ceil(SWATCH / side - 1e-9) for side in np.diagonal(tile.lattice))
    cloth, (printed,) = print_layout([tile_sheet(tile, "x", *counts)], region, CLAMPED)
    return cloth, printed


def print_layout(
    sheets: Sequence[TileSheet], region: BaseGeometry, margin: float
) -> tuple[Pattern, list[BaseGeometry]]:
    """Return the cloth of sheets with margins for the clamps, and the print on it.

    Args:
        sheets: Sheets of the tile.
        region: The print on one tile, in m.
        margin: Length in m of unprinted cloth at both ends of each sheet.

    Returns:
        A pattern with one panel for each sheet, and the printed region of each panel, in m. The
        print is continuous across the borders of tiles.

    Raises:
        ParameterError: The margin is negative or not finite.
    """
    require_between(0.0, np.inf, margin=margin)
    corners, regions = [], []
    for sheet in sheets:
        offset = np.where(np.arange(2) == sheet.axis, margin, 0.0)
        size = sheet.pattern.flat_points.max(axis=0) + 2 * offset
        corners.append(size * [[0, 0], [1, 0], [1, 1], [0, 1]])
        whole = shapely.simplify(repeated(region, sheet.tile, *sheet.counts), COLLINEAR)
        regions.append(translate(whole, *offset))
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
