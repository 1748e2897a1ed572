"""A printed tile: its triangles, mesh, materials and file, and the sheets that it makes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import DensityError, ParameterError, TileFileError
from toros_fem.base.mpi import collective, on_first_rank, on_root
from toros_fem.base.validation import (
    checked_path,
    require_between,
    require_choice,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.making.print.printability import printed_fractions
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.makers.tile import KINDS, Tile, check_symmetry, tile
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tiles.printability import repeated

NAME, KIND = "tile.npz", "tile"
MEMBRANE = Composite(bending=None)
DIRECTIONS = ("x", "y")
# Corners of triangles closer than this to a straight border of the print, in m, are left out.
COLLINEAR = 1e-9
# A triangle is printed if at least half its area is. The margin is for rounding: of triangles that
# a symmetry maps to each other all are printed, or none.
HALF = 0.5 - 1e-6
# Least size of a swatch, and its unprinted cloth at both ends for clamps, in m.
SWATCH, CLAMPED = 50e-3, 20e-3


@dataclass(frozen=True, eq=False)
class PrintedTile:
    """A tile whose triangles are either printed or plain fabric.

    Attributes:
        printed: Whether each triangle of the tile's mesh is printed, (t,).
        size: Its sides (a, b) in m.
        edge_length, mesh, symmetry: Parameters of its mesh, as for `meshes.tile.tile`.
        composite: Its materials, as a membrane without a bladder.

    Raises:
        DensityError: `printed` is not an array of True or False.
        ParameterError: A number is outside its range, a name is unknown, or the composite bends,
            has a bladder, or a knit whose grain is given by panels.
    """

    printed: Bools
    size: tuple[float, float]
    edge_length: float
    mesh: str = "crossed"
    symmetry: str = "none"
    composite: Composite = MEMBRANE

    def __post_init__(self) -> None:
        if not isinstance(self.printed, np.ndarray):
            raise DensityError(
                f"printed = {shown(self.printed)} must be an array of True or False, (t,)."
            )
        if self.printed.dtype != bool or self.printed.ndim != 1:
            raise DensityError(
                f"printed is {self.printed.dtype} of shape {self.printed.shape}; it must be bool, "
                "(t,), True for each printed triangle."
            )
        if not isinstance(self.size, list | tuple) or len(self.size) != 2:
            raise ParameterError(f"size = {shown(self.size)} must be two sides (a, b) in m.")
        require_kind("composite", self.composite, Composite, "a Composite")
        require_positive(size_x=self.size[0], size_y=self.size[1], edge_length=self.edge_length)
        require_choice("mesh", self.mesh, KINDS)
        check_symmetry(self.symmetry, np.array(self.size))
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

    @collective("comm")
    def tile(self, comm: MPI.Comm) -> Tile:
        """Make the tile on its mesh (collective).

        Raises:
            ParameterError: The mesh cannot be made.
            DensityError: The mesh and `printed` have different numbers of triangles.
        """
        meshed = tile(comm, self.size, self.edge_length, self.mesh, self.symmetry)
        if len(meshed.wraps) != len(self.printed):
            raise DensityError(
                f"printed has {len(self.printed)} triangles, but the tile of {self.size[0]:g} m × "
                f"{self.size[1]:g} m, edge_length = {self.edge_length:g} m, mesh = {self.mesh!r} "
                f"and symmetry = {self.symmetry!r} has {len(meshed.wraps)}. Give the numbers that "
                "it was designed with, or design it anew: another version of gmsh may make another "
                "mesh."
            )
        return meshed


def write_tile(folder: str | Path, printed_tile: PrintedTile) -> None:
    """Write a printed tile as the archive `tile.npz` into a folder (one rank)."""
    require_kind("printed_tile", printed_tile, PrintedTile, "a PrintedTile")
    folder, numbers = checked_path("folder", folder), dict(vars(printed_tile))
    printed = numbers.pop("printed")
    numbers["composite"] = printed_tile.composite.as_dict()
    write_archive(folder / NAME, Archive(KIND, {"printed": printed}, numbers))


@on_root
def read_tile(comm: MPI.Comm, folder: str | Path) -> PrintedTile:
    """Read the printed tile that `write_tile` wrote into a folder (collective).

    Raises:
        TileFileError: There is no such file, it is damaged, or holds no valid tile.
    """
    path = checked_path("folder", folder, TileFileError) / NAME

    def make(archive: Archive) -> PrintedTile:
        numbers = dict(archive.numbers)
        composite = Composite.of_dict(numbers.pop("composite"))
        size = tuple(numbers.pop("size"))
        return PrintedTile(archive.arrays["printed"], size, composite=composite, **numbers)

    remedy = "Give the output folder of demos/tile.py."
    return read_archive(path, KIND, make, TileFileError, remedy)


@collective("comm")
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
        return printed_fractions(new.pattern, [region]) >= HALF

    return replace(printed_tile, printed=on_first_rank(comm, sample), edge_length=edge_length)


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


def swatch(tile: Tile, region: BaseGeometry) -> tuple[Pattern, BaseGeometry]:
    """Return the cloth of a piece of tiles, at least 5 cm wide each way, and the print on it.

    The region is that of one tile, in m.
    """
    along, across = (math.ceil(SWATCH / side - 1e-9) for side in np.diagonal(tile.lattice))
    plain = np.zeros(len(tile.wraps), dtype=bool)
    cloth, _ = print_layout([tile_sheet(tile, "x", along, across)], plain, CLAMPED)
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
