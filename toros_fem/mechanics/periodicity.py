"""What a tile's triangles see across its border: which nodes the lattice moves, and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx import fem

from toros_fem._types import Floats
from toros_fem.errors import ParameterError
from toros_fem.mechanics.hinges import neighbours
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.tile import Tile

# Components of F̄, rows n, t, z and columns n, t: a sheet that is pulled along n and free across.
UNIAXIAL = ((True, False), (True, False), (True, True))
# All of them, to be given.
ALL_PRESCRIBED = ((True, True), (True, True), (True, True))


@dataclass(frozen=True, eq=False)
class Periodic:
    """A tile and what is held of it.

    The mean deformation gradient F̄ is part of the state. Its components belong to directions n
    along and t across, in the flat sheet and in space alike, and z out of the plane.

    Attributes:
        tile: The tile.
        held: Which components of F̄ are given, rows n, t, z, columns n, t; no mean force belongs
            to the others. Held must be what keeps the tile from turning.
        flat: Whether the sheet stays in its plane; otherwise it may buckle.

    Raises:
        ParameterError: `prescribed` has another shape, or lets the tile turn.
    """

    tile: Tile
    prescribed: tuple[tuple[bool, bool], ...] = UNIAXIAL
    flat: bool = True

    def __post_init__(self) -> None:
        prescribed = np.array(self.prescribed, dtype=object)  # rows may be of different lengths
        if prescribed.shape != (3, 2) or not all(
            isinstance(h, bool | np.bool_) for h in prescribed.flat
        ):
            raise ParameterError(
                f"prescribed has shape {prescribed.shape}; it must be 3 × 2 of True or False, one "
                "for each component of the mean deformation gradient."
            )
        if not (prescribed[2, 0] and prescribed[2, 1]) or not (
            prescribed[1, 0] or prescribed[0, 1]
        ):
            raise ParameterError(
                "the mean deformation gradient may turn the tile: prescribe its z components, "
                "and that along t of the column n, or that along n of the column t."
            )

    @property
    def length(self) -> float:
        """Length in m by which F̄ becomes unknowns in m: that of the tile."""
        return float(np.sqrt(abs(np.linalg.det(self.tile.lattice))))


class PeriodicImages:
    """How far each node a triangle sees lies from the node's own place, as a share of F̄'s columns.

    Attributes:
        coefficients: These shares in the forms, one vector (n, t) for each corner and flap.
        moved: Which nodes of owned triangles are images at all, (k, nodes).

    Args:
        skin: The tile's sewn skin.
        periodic: The tile.
        bends: Whether triangles see flaps too.
    """

    def __init__(self, skin: Skin, periodic: Periodic, *, bends: bool) -> None:
        tile = periodic.tile
        corner = skin.position_space.dofmap.list
        original = skin.cell[skin.density_space.dofmap.list[:, 0]]
        vertex = skin.vertex[corner]
        place = np.argmax(
            tile.pattern.triangles[original][:, None, :] == vertex[:, :, None], axis=2
        )
        wraps = np.take_along_axis(tile.wraps[original], place[:, :, None], axis=1)
        if bends:
            wraps = np.concatenate([wraps, _of_flaps(skin, wraps)], axis=1)
        self._steps = (wraps @ tile.lattice) / periodic.length
        self.moved = np.any(wraps[: len(skin.owned_cells)] != 0, axis=2)
        space = fem.functionspace(skin.mesh, basix.ufl.element("DG", "triangle", 0, shape=(2,)))
        self._row = space.dofmap.list[:, 0]
        self.coefficients: list[Any] = [fem.Function(space) for _ in range(wraps.shape[1])]
        self.shares: Floats = np.zeros_like(self._steps)
        self.turn(0.0)

    def turn(self, angle: float) -> None:
        """Take n at an angle in rad to the first axis of the flat sheet."""
        c, s = np.cos(angle), np.sin(angle)
        self.shares = self._steps @ np.array([[c, -s], [s, c]])
        for k, coefficient in enumerate(self.coefficients):
            coefficient.x.array.reshape(-1, 2)[self._row] = self.shares[:, k]

    def added(self, columns: Floats) -> Floats:
        """What is added to the nodes of owned triangles, (k, nodes, 3), by columns (2, 3)."""
        return np.asarray(self.shares[: len(self.moved)] @ columns)


def _of_flaps(skin: Skin, wraps: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Wraps of the flaps as the triangle sees them, (cells, 3, 2)."""
    corner = skin.position_space.dofmap.list
    neighbour, opposite = neighbours(skin)
    first = np.roll(corner, -1, axis=1)
    there = np.argmax(corner[neighbour] == first[:, :, None], axis=2)
    own = np.roll(wraps, -1, axis=1)
    # Both triangles of an edge see its first end; where they see it apart, all the rest is too.
    return np.asarray(wraps[neighbour, opposite] + own - wraps[neighbour, there])
