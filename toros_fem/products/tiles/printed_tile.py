"""A printed tile as a file: its printed triangles, its mesh and its materials."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from toros_fem.base.archive import Archive, read_archive, write_archive
from toros_fem.base.array_types import Bools
from toros_fem.base.errors import DensityError, ParameterError, TileFileError
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import (
    checked_path,
    require_choice,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.makers.tile import KINDS, Tile, check_symmetry, tile

NAME, KIND = "tile.npz", "tile"
MEMBRANE = Composite(bending=None)


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


@collective("comm")
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
    return on_first_rank(comm, lambda: read_archive(path, KIND, make, TileFileError, remedy))
