"""Periodic tiles: prescribed mean deformation, images across the border, and the tile's model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
from dolfinx import fem

from toros_fem._types import Bools, Floats, Ints, LocalInts
from toros_fem.errors import ParameterError
from toros_fem.materials import Composite
from toros_fem.mechanics.hinges import neighbours
from toros_fem.mechanics.model import SkinModel
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.tile import Tile

# Components of F̄, rows n, t, z and columns n, t: a sheet that is pulled along n and free across.
UNIAXIAL = ((True, False), (True, False), (True, True))
# All components prescribed.
ALL_PRESCRIBED = ((True, True), (True, True), (True, True))


@dataclass(frozen=True, eq=False)
class Periodic:
    """A tile and the prescribed components of its mean deformation gradient F̄.

    F̄ is part of the state. Its components belong to the directions n (along), t (across), both
    in the flat sheet and in space, and z (out of the plane).

    Attributes:
        tile: The tile.
        prescribed: Whether each component of F̄ is prescribed, rows n, t, z, columns n, t. The
            mean force of the others is zero. The prescribed ones must keep the tile from turning.
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
    """Distance of each node that a triangle sees from the node's own place, in columns of F̄.

    Attributes:
        coefficients: These shifts in the forms, one vector (n, t) for each corner and flap.
        shifts: The same as numbers, over the tile's length, (cells, nodes, 2).
        moved: Whether each node of the owned triangles is an image, (k, nodes).

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
            wraps = np.concatenate([wraps, _wraps_of_flaps(skin, wraps)], axis=1)
        self._steps = (wraps @ tile.lattice) / periodic.length
        self.moved: Bools = np.any(wraps[: len(skin.owned_cells)] != 0, axis=2)
        space = fem.functionspace(skin.mesh, basix.ufl.element("DG", "triangle", 0, shape=(2,)))
        self._row = space.dofmap.list[:, 0]
        self.coefficients: list[Any] = [fem.Function(space) for _ in range(wraps.shape[1])]
        self.shifts: Floats = np.zeros_like(self._steps)
        self.turn(0.0)

    def turn(self, angle: float) -> None:
        """Set the angle in rad between n and the first axis of the flat sheet."""
        c, s = np.cos(angle), np.sin(angle)
        self.shifts = self._steps @ np.array([[c, -s], [s, c]])
        for k, coefficient in enumerate(self.coefficients):
            coefficient.x.array.reshape(-1, 2)[self._row] = self.shifts[:, k]

    def moves(self, columns: Floats) -> Floats:
        """Return the moves of the owned triangles' nodes, (k, nodes, 3), by columns (2, 3) of F̄."""
        return np.asarray(self.shifts[: len(self.moved)] @ columns)


def _wraps_of_flaps(skin: Skin, wraps: Ints) -> Ints:
    """Wraps of the flaps as the triangle sees them, (cells, 3, 2)."""
    corner = skin.position_space.dofmap.list
    neighbour, opposite = neighbours(skin)
    first = np.roll(corner, -1, axis=1)
    there = np.argmax(corner[neighbour] == first[:, :, None], axis=2)
    own = np.roll(wraps, -1, axis=1)
    # Both triangles of an edge see its first end. Where they see it at different places, the whole
    # neighbour is shifted by the difference.
    return np.asarray(wraps[neighbour, opposite] + own - wraps[neighbour, there])


class PeriodicModel(SkinModel):
    """Model of a tile that repeats: x = F̄ x̄ + w with a periodic w.

    The columns of the mean deformation gradient F̄, times the tile's length, are the last unknowns
    of the first rank. Positions and F̄ are in axes n, t, z.

    Attributes:
        periodic: The tile and the prescribed components of F̄.
        images: Shifts of the nodes that triangles see across the border.
        lattice_dofs: Local unknowns of F̄n and F̄t, (2, 3), on every rank.

    Args:
        skin: The tile's sewn skin.
        composite: The two materials and the stretch bounds.
        supports: Fixed components; with F̄'s prescribed ones they must leave no rigid motion.
        periodic: The tile.
    """

    def __init__(
        self, skin: Skin, composite: Composite, supports: Supports, periodic: Periodic
    ) -> None:
        self.periodic = periodic
        self.images = PeriodicImages(skin, periodic, bends=composite.bending is not None)
        shifts = self.images.coefficients
        self._set_up(skin, composite, supports, None, None, closed=False, lattice_shifts=shifts)
        self.lattice_dofs: LocalInts = self._patch.lattice_dofs
        self.fixed[self.lattice_dofs] = np.array(periodic.prescribed).T
        self.free = ~self.fixed[: self.size_local]

    @property
    def assembled(self) -> Floats:
        """Flat sheet with F̄ = 1 as a state."""
        state = super().assembled
        self.set_mean_gradient(state, np.eye(3)[:, :2])
        return state

    def set_mean_gradient(self, state: Floats, gradient: Floats) -> None:
        """Write a mean deformation gradient F̄, (3, 2), into the owned unknowns of a state."""
        owned = self.lattice_dofs < self.size_local
        values = self.periodic.length * np.asarray(gradient).T
        state[self.lattice_dofs[owned]] = values[owned]

    def mean_gradient(self, state: Floats) -> Floats:
        """Return F̄ of a state, (3, 2), on every rank; also sets the state."""
        self.set_state(state)
        return np.asarray(self.q.x.array[self.lattice_dofs].T / self.periodic.length)

    def mean_force(self, state: Floats) -> Floats:
        """Return ∂E/∂F̄ in J, (3, 2), on every rank."""
        owned = self.lattice_dofs[self.lattice_dofs < self.size_local]
        force = self._variation(state)[owned].reshape(-1, 3)
        columns = np.asarray(self.skin.comm.bcast(force, root=0))
        return np.asarray(self.periodic.length * columns.T)

    def _patch_positions(self, nodes: int) -> Floats:
        columns = self.q.x.array[self.lattice_dofs]
        return np.asarray(super()._patch_positions(nodes) + self.images.moves(columns)[:, :nodes])
