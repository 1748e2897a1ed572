"""A printed tile: its print, mesh, materials and file, and the sheet that it makes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.array_types import Bools
from toros_fem.base.errors import FileError, ParameterError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    checked_path,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.making.print.regions import packed_regions, regions_of
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.makers.tile import Tile, tile
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tiles.printability import repeated

NAME, KIND = "tile.npz", "tile"
MEMBRANE = Composite(bending=None)
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
        numbers = dict(archive.numbers)
        composite = Composite(**numbers.pop("composite"))
        size = tuple(numbers.pop("size"))
        (region,) = regions_of(archive, 1)
        return PrintedTile(region, size, composite=composite, **numbers)

    remedy = "Give the output folder of demos/tile.py."
    return read_archive(path, KIND, make, FileError, remedy)


def swatch(tile: Tile, region: BaseGeometry) -> tuple[Pattern, BaseGeometry]:
    """Return the cloth of a piece of tiles, at least 5 cm wide each way, and the print on it.

    The region is that of one tile, in m.
    """
    along, across = (math.ceil(SWATCH / side - 1e-9) for side in np.diagonal(tile.lattice))
    return print_layout(tile, region, (along, across), CLAMPED)


def print_layout(
    tile: Tile, region: BaseGeometry, counts: tuple[int, int], margin: float
) -> tuple[Pattern, BaseGeometry]:
    """Return the cloth of a sheet of tiles, and the print on it, continuous across their borders.

    Args:
        tile: The tile.
        region: The print on one tile, in m.
        counts: Numbers of tiles along x and y.
        margin: Length in m of unprinted cloth at both ends along x, for clamps.
    """
    size = np.array(counts) * np.diagonal(tile.lattice) + [2 * margin, 0.0]
    corners = size * [[0, 0], [1, 0], [1, 1], [0, 1]]
    whole = shapely.simplify(repeated(region, tile, *counts), COLLINEAR)
    cloth = Pattern(
        flat_points=corners,
        flat_triangles=np.array([[0, 1, 2], [0, 2, 3]]),
        panel=np.zeros(2, dtype=int),
        sewn=np.arange(4),
        points=np.column_stack([corners, np.zeros(4)]),
        panel_names=("along_x",),
    )
    return cloth, translate(whole, margin, 0.0)
