"""A printed tile as a file: which triangles are printed, how its mesh is made, its materials."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem._mpi import on_first_rank
from toros_fem._validate import require_choice, require_positive
from toros_fem.errors import DensityError, TileFileError, TorosError
from toros_fem.materials import Composite, Material
from toros_fem.meshes.tile import KINDS, Tile, tile
from toros_fem.meshes.tile_symmetry import check_symmetry

NAME = "tile.npz"
NUMBERS = ("edge_length", "fabric_young", "reinforcement_young", "poisson", "thickness", "c1", "c2")
WORDS = ("mesh", "symmetry")


@dataclass(frozen=True, eq=False)
class PrintedTile:
    """A tile each of whose triangles is printed or plain.

    Attributes:
        printed: Whether each triangle of the tile's mesh is printed, (t,).
        size: Its sides (a, b) in m.
        edge_length, mesh, symmetry: How its mesh is made, as of `meshes.tile.tile`.
        fabric_young, reinforcement_young: Young's moduli in Pa.
        poisson, thickness: Of both materials; the thickness in m.
        c1, c2: Stretch bounds.

    Raises:
        DensityError: `printed` does not tell True or False of triangles.
        ParameterError: A number is outside its range, or a name is unknown.
    """

    printed: npt.NDArray[np.bool_]
    size: tuple[float, float]
    edge_length: float
    mesh: str = "crossed"
    symmetry: str = "none"
    fabric_young: float = Composite.fabric.young
    reinforcement_young: float = Composite.reinforcement.young
    poisson: float = Composite.fabric.poisson
    thickness: float = Composite.fabric.thickness
    c1: float = Composite.c1
    c2: float = Composite.c2

    def __post_init__(self) -> None:
        if self.printed.dtype != bool or self.printed.ndim != 1:
            raise DensityError(
                f"printed is {self.printed.dtype} of shape {self.printed.shape}; it must be bool, "
                "(t,), True for each triangle that is printed."
            )
        require_positive(size_x=self.size[0], size_y=self.size[1], edge_length=self.edge_length)
        require_choice("mesh", self.mesh, KINDS)
        check_symmetry(self.symmetry, np.array(self.size))
        _ = self.composite  # checks the materials

    @property
    def composite(self) -> Composite:
        """Its materials, as a membrane: in its plane a sheet does not bend."""
        fabric, reinforcement = (
            Material(young, self.poisson, self.thickness)
            for young in (self.fabric_young, self.reinforcement_young)
        )
        return Composite(fabric, reinforcement, self.c1, self.c2, bending=None)

    def tile(self, comm: MPI.Comm) -> Tile:
        """The tile on its mesh (collective).

        Raises:
            ParameterError: The mesh cannot be made.
            DensityError: It has another number of triangles than `printed` tells of.
        """
        made = tile(comm, self.size, self.edge_length, self.mesh, self.symmetry)
        if len(made.wraps) != len(self.printed):
            raise DensityError(
                f"printed tells of {len(self.printed)} triangles, but the tile of {self.size[0]:g} "
                f"m × {self.size[1]:g} m, edge_length = {self.edge_length:g} m, mesh = "
                f"{self.mesh!r} and symmetry = {self.symmetry!r} has {len(made.wraps)}. Give the "
                "numbers that it was designed with, or design it anew: another version of gmsh "
                "may make another mesh."
            )
        return made


def write_tile(folder: Path, made: PrintedTile) -> None:
    """Write a printed tile as `tile.npz` into a folder (one rank)."""
    entries = {name: getattr(made, name) for name in (*NUMBERS, *WORDS)}
    size_x, size_y = made.size
    np.savez_compressed(
        folder / NAME, printed=made.printed, size_x=size_x, size_y=size_y, **entries
    )


def read_tile(comm: MPI.Comm, folder: Path) -> PrintedTile:
    """The printed tile in a folder, as `write_tile` has left it (collective).

    Raises:
        TileFileError: There is no such file, it lacks an entry, or one has no admissible value.
    """
    path = folder / NAME

    def read() -> PrintedTile:
        try:
            with np.load(path) as archive:
                entries = dict(archive)
        # A lone array or another kind of file is no archive to be opened.
        except (OSError, ValueError, EOFError, TypeError, BadZipFile, zlib.error) as caught:
            raise TileFileError(
                f"{path} cannot be read: {caught}. Name the output folder of demos/tile.py."
            ) from None
        wanted = ("printed", "size_x", "size_y", *NUMBERS, *WORDS)
        missing = [name for name in wanted if name not in entries]
        if missing:
            raise TileFileError(
                f"{path} lacks {', '.join(missing)}. Write it by toros_fem.tile_file.write_tile."
            )
        try:
            numbers = {name: float(entries[name].item()) for name in ("size_x", "size_y", *NUMBERS)}
            words = {name: str(entries[name].item()) for name in WORDS}
            size = (numbers.pop("size_x"), numbers.pop("size_y"))
            return PrintedTile(entries["printed"], size, **numbers, **words)  # type: ignore[arg-type]
        except (TorosError, ValueError, TypeError) as caught:
            raise TileFileError(f"{path} holds no printed tile: {caught}") from None

    return on_first_rank(comm, read)
