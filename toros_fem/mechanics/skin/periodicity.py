"""Periodic tiles: prescribed mean deformation, images across the border, model and tangent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix.ufl
import numpy as np
from dolfinx import fem, la

from toros_fem.base.array_types import Bools, Floats, Ints, LocalInts
from toros_fem.base.errors import ParameterError
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.coefficients import work_vector
from toros_fem.mechanics.skin.hinges import neighbours
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.supports import Supports
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


class PeriodicTangent:
    """Tangent entries at the columns of F̄, from the matrices of triangles that see images.

    A triangle's matrix A belongs to the places where it sees its nodes, x + a F̄n + b F̄t. The
    matrix of the unknowns is EᵀAE with E = (1, a, b) for each node. The part of the 1 is that of
    all triangles and is not repeated here.

    Attributes:
        keys: Entry row · size + column of each number, row ≤ column.
        weights: Factor of each number: 2 on the diagonal, where (i, j) and (j, i) coincide.

    Args:
        model: A tile.
    """

    def __init__(self, model: PeriodicModel) -> None:
        self._model, self._images = model, model.images
        index_map = model.space.dofmap.index_map
        size = index_map.size_global
        local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        number = np.where(model.fixed, -1, index_map.local_to_global(local))
        place, dofs, present = model.tangent_layout
        self._cells = cells = np.flatnonzero(self._images.moved.any(axis=1))
        self._count = dofs.shape[1]
        entries = self._count * (self._count + 1) // 2
        self._first = place[cells].astype(np.int64) * entries
        self._present, self._dofs = present[cells], dofs[cells]
        # For each component of each node: its own number, that of F̄n and that of F̄t.
        nodes = self._count // 3
        moved = np.zeros((len(cells), nodes), dtype=bool)
        moved[:, : self._images.moved.shape[1]] = self._images.moved[cells]
        targets = np.full((len(cells), nodes, 3, 3), -1, dtype=np.int64)
        targets[:, :, 0] = number[self._dofs].reshape(len(cells), nodes, 3)
        columns = number[model.lattice_dofs]
        targets[:, :, 1:] = np.where(moved[:, :, None, None], columns, -1)
        targets[~self._present.reshape(len(cells), nodes, 3)[:, :, 0]] = -1
        parts: list[Ints] = [np.zeros((5, 0), dtype=np.int64)]
        for n, (i, j) in enumerate(zip(*np.triu_indices(self._count), strict=True)):
            (u, k), (v, m) = divmod(i, 3), divmod(j, 3)
            for a in range(3):
                for b in range(a if i == j else 0, 3):
                    p, q = targets[:, u, a, k], targets[:, v, b, m]
                    c = np.flatnonzero((p >= 0) & (q >= 0))
                    if a == b == 0 or len(c) == 0:
                        continue
                    low, high = np.minimum(p, q)[c], np.maximum(p, q)[c]
                    count = np.where((low == high) & (i != j), 2, 1)
                    one, two = (c * nodes + u) * 3 + a, (c * nodes + v) * 3 + b
                    parts.append(np.stack([low * size + high, self._first[c] + n, one, two, count]))
        self.keys, self._sources, self._one, self._two, count = np.concatenate(parts, axis=1)
        self.weights = count.astype(np.float64)
        self._vector = work_vector(model.space)

    def _factors(self) -> Floats:
        """1, a, b of each node of the triangles that see images, (cells, nodes, 3)."""
        shifts = self._images.shifts[self._cells]
        factors = np.zeros((len(self._cells), self._count // 3, 3))
        factors[:, :, 0] = 1.0
        factors[:, : shifts.shape[1], 1:] = shifts
        return factors

    def values(self, entries: Floats) -> Floats:
        """Return the numbers that belong to `keys`, from those of `SkinModel.tangent_entries`."""
        factors = self._factors().ravel()
        return np.asarray(entries[self._sources] * factors[self._one] * factors[self._two])

    def force(self, entries: Floats, change: Floats) -> Floats:
        """Return the change of the first variation, at all owned unknowns, by F̄ alone (collective).

        Args:
            entries: As `SkinModel.tangent_entries` returns them.
            change: Change of F̄, (3, 2).
        """
        model, count = self._model, self._count
        row, column = np.triu_indices(count)
        matrix = np.zeros((len(self._cells), count, count))
        matrix[:, row, column] = entries[self._first[:, None] + np.arange(len(row))]
        matrix[:, column, row] = matrix[:, row, column]
        matrix *= self._present[:, :, None] & self._present[:, None, :]
        factors = self._factors()
        moves = model.periodic.length * factors[:, :, 1:] @ np.asarray(change).T
        forces = (matrix @ moves.reshape(len(moves), count, 1)).reshape(moves.shape)
        out = self._vector.array
        out[:] = 0
        np.add.at(out, self._dofs.ravel(), forces.ravel())
        np.add.at(out, model.lattice_dofs, np.einsum("cua,cuk->ak", factors[:, :, 1:], forces))
        self._vector.scatter_reverse(la.InsertMode.add)
        return np.array(out[: model.size_local])
