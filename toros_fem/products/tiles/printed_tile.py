"""A printed tile as a file: its printed triangles, its mesh and its materials."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools
from toros_fem.base.errors import DensityError, ParameterError, TileFileError, TorosError
from toros_fem.base.files import UNREADABLE, reason
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import (
    checked_path,
    require_choice,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.materials.sheet import Composite, Knit, Material
from toros_fem.meshes.makers.tile import KINDS, Tile, check_symmetry, tile

NAME = "tile.npz"
MATERIALS = ("fabric", "reinforcement")
PROPERTIES = ("young", "poisson", "thickness")
BOUNDS = ("c1", "c2")  # a material's own, if it has any
# Files of earlier versions have one entry of these for both materials.
COMMON = ("poisson", "thickness")
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
    """Write a printed tile as `tile.npz` into a folder (one rank)."""
    require_kind("printed_tile", printed_tile, PrintedTile, "a PrintedTile")
    folder = checked_path("folder", folder)
    p, composite = printed_tile, printed_tile.composite
    entries: dict[str, Any] = {
        "printed": p.printed,
        "size_x": p.size[0],
        "size_y": p.size[1],
        "edge_length": p.edge_length,
        "mesh": p.mesh,
        "symmetry": p.symmetry,
        "c1": composite.c1,
        "c2": composite.c2,
    }
    for name in MATERIALS:
        material = getattr(composite, name)
        entries.update({f"{name}_{key}": getattr(material, key) for key in PROPERTIES})
        own = {f"{name}_{key}": getattr(material, key) for key in BOUNDS}
        entries.update({key: value for key, value in own.items() if value is not None})
    if composite.knit is not None:
        entries.update(knit_ratio=composite.knit.ratio, knit_grain=composite.knit.grain)
    np.savez_compressed(folder / NAME, **entries)


@collective("comm")
def read_tile(comm: MPI.Comm, folder: str | Path) -> PrintedTile:
    """Read the printed tile that `write_tile` wrote into a folder (collective).

    Raises:
        TileFileError: There is no such file, or an entry is missing or not valid.
    """
    path = checked_path("folder", folder, TileFileError) / NAME

    def read() -> PrintedTile:
        try:
            with np.load(path) as archive:
                entries = dict(archive)
        except UNREADABLE as caught:
            raise TileFileError(
                f"{path} cannot be read: {reason(caught)}. Give the output folder of demos/tile.py."
            ) from None
        for key in COMMON:
            if key in entries:
                entries.update({f"{name}_{key}": entries[key] for name in MATERIALS})
        required = ("printed", "size_x", "size_y", "edge_length", "mesh", "symmetry", "c1", "c2")
        properties = tuple(f"{name}_{key}" for name in MATERIALS for key in PROPERTIES)
        knit = ("knit_grain",) if "knit_ratio" in entries else ()
        missing = [name for name in required + properties + knit if name not in entries]
        if missing:
            raise TileFileError(f"{path} lacks {', '.join(missing)}. Write it by write_tile.")
        try:
            return _printed_tile(entries)
        except (TorosError, ValueError, TypeError) as caught:
            raise TileFileError(f"{path} contains no printed tile: {caught}") from None

    return on_first_rank(comm, read)


def _printed_tile(entries: dict[str, Any]) -> PrintedTile:
    def number(name: str) -> float:
        return float(entries[name].item())

    fabric, reinforcement = (
        Material(
            *(number(f"{name}_{key}") for key in PROPERTIES),
            **{key: number(f"{name}_{key}") for key in BOUNDS if f"{name}_{key}" in entries},
        )
        for name in MATERIALS
    )
    knit = Knit(number("knit_ratio"), number("knit_grain")) if "knit_ratio" in entries else None
    return PrintedTile(
        printed=entries["printed"],
        size=(number("size_x"), number("size_y")),
        edge_length=number("edge_length"),
        mesh=str(entries["mesh"].item()),
        symmetry=str(entries["symmetry"].item()),
        composite=Composite(
            fabric, reinforcement, c1=number("c1"), c2=number("c2"), bending=None, knit=knit
        ),
    )
