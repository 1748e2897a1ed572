"""Entries of a tile's tangent at its mean deformation gradient."""

from __future__ import annotations

import numpy as np
from dolfinx import la

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.compiled_forms import work_vector
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.terms.images import Images


class PeriodicTangent:
    """Tangent entries at the columns of F̄, from the matrices of triangles that see images.

    A triangle's matrix A belongs to the places where it sees its nodes, x + a F̄n + b F̄t. The
    matrix of the unknowns is EᵀAE with E = (1, a, b) for each node. The part of the 1 is that of
    all triangles and is not repeated here.

    Attributes:
        keys: Entry row · size + column of each number, row ≤ column.
        weights: Factor of each number: 2 on the diagonal, where (i, j) and (j, i) coincide.

    Args:
        model: Model of a tile.
        images: Its images.
    """

    def __init__(self, model: SkinModel, images: Images) -> None:
        self._model, self._images = model, images
        index_map = model.space.dofmap.index_map
        size = index_map.size_global
        local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        number = np.where(model.fixed, -1, index_map.local_to_global(local))
        place, dofs, present = model.tangent_layout
        self._cells = cells = np.flatnonzero(self._images.images.any(axis=1))
        self._count = dofs.shape[1]
        entries = self._count * (self._count + 1) // 2
        self._first = place[cells].astype(np.int64) * entries
        self._present, self._dofs = present[cells], dofs[cells]
        # For each component of each node: its own number, that of F̄n and that of F̄t.
        nodes = self._count // 3
        moved = np.zeros((len(cells), nodes), dtype=bool)
        moved[:, : self._images.images.shape[1]] = self._images.images[cells]
        targets = np.full((len(cells), nodes, 3, 3), -1, dtype=np.int64)
        targets[:, :, 0] = number[self._dofs].reshape(len(cells), nodes, 3)
        columns = number[self._images.dofs]
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
        moves = self._images.periodic.length * factors[:, :, 1:] @ np.asarray(change).T
        forces = (matrix @ moves.reshape(len(moves), count, 1)).reshape(moves.shape)
        out = self._vector.array
        out[:] = 0
        np.add.at(out, self._dofs.ravel(), forces.ravel())
        np.add.at(out, self._images.dofs, np.einsum("cua,cuk->ak", factors[:, :, 1:], forces))
        self._vector.scatter_reverse(la.InsertMode.add)
        return np.array(out[: model.size_local])
