"""Periodic tiles and their prescribed mean deformation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # who makes a tile has imported it
    from toros_fem.meshes.makers.tile import Tile

# Components of F̄, rows n, t, z and columns n, t: a sheet that is pulled along n and free across.
UNIAXIAL = ((True, False), (True, False), (True, True))
# All components prescribed.
ALL_PRESCRIBED = ((True, True), (True, True), (True, True))


@dataclass(frozen=True, eq=False)
class Periodic:
    """A tile and the prescribed components of its mean deformation gradient F̄.

    F̄ is part of the state. Its components belong to the directions n (along), t (across), both in
    the flat sheet and in space, and z (out of the plane).

    Attributes:
        tile: The tile.
        prescribed: Whether each component of F̄ is prescribed, rows n, t, z, columns n, t. The mean
            force of the others is zero. The prescribed ones must keep the tile from turning.
        flat: Whether the sheet stays in its plane; otherwise it may buckle.
    """

    tile: Tile
    prescribed: tuple[tuple[bool, bool], ...] = UNIAXIAL
    flat: bool = True

    @property
    def length(self) -> float:
        """Length in m by which F̄ becomes unknowns in m: that of the tile."""
        return float(np.sqrt(abs(np.linalg.det(self.tile.lattice))))
