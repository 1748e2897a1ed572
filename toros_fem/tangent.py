"""The tangent's upper triangle, summed from element entries by a map that is made once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import csr_matrix

from toros_fem.model import SkinModel

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class UpperTangent:
    """Second variation of E in N/m, entries (i, j) with i ≤ j of the rows this rank owns.

    The tangent is symmetric, so its lower half is neither computed nor kept. Each triangle gives
    the upper triangle of its element matrix; which of these numbers add up to which entry never
    changes, so that assembly is one sparse product and, on several ranks, one exchange. Held rows
    and columns are those of the identity.

    Attributes:
        indptr, columns: Compressed rows: columns are global, sorted, the diagonal comes first.

    Args:
        model: The scene.
    """

    def __init__(self, model: SkinModel) -> None:
        self._model = model
        comm = model.skin.comm
        index_map = model.space.dofmap.index_map
        size = index_map.size_global
        starts = np.array(comm.allgather(index_map.local_range[0]) + [size], dtype=np.int64)
        keys, weights = _contributions(model)

        order = np.argsort(keys, kind="stable")
        order = order[np.searchsorted(keys[order], 0) :]
        sorted_keys = keys[order]
        first = np.flatnonzero(np.diff(sorted_keys, prepend=-1))
        own_keys = sorted_keys[first]
        self._sum = csr_matrix(
            (weights[order], order, np.append(first, len(order))), shape=(len(first), len(keys))
        )

        # Entries are sorted by row, so those of one owner are neighbours.
        bounds = np.searchsorted(own_keys, starts * size)
        self._send: Ints = np.diff(bounds)
        self._send[comm.rank] = 0
        self._own = slice(bounds[comm.rank], bounds[comm.rank + 1])
        self._outgoing = np.r_[0 : self._own.start, self._own.stop : len(own_keys)]
        self._receive: Ints = np.array(comm.alltoall(list(self._send)), dtype=np.int64)
        incoming = np.empty(self._receive.sum(), dtype=np.int64)
        comm.Alltoallv([own_keys[self._outgoing], self._send], [incoming, self._receive])
        kept = own_keys[self._own]
        merged = np.union1d(kept, incoming)
        self._own_places = np.searchsorted(merged, kept)
        self._incoming_places = np.searchsorted(merged, incoming)

        begin, end = index_map.local_range
        self.indptr = np.searchsorted(merged, np.arange(begin, end + 1) * size).astype(np.int32)
        self.columns = (merged % size).astype(np.int32)
        self._entries: Floats = np.ones(len(keys))  # held dofs stand last and keep their 1

    @property
    def diagonal(self) -> npt.NDArray[np.int32]:
        """Places of the diagonal among the entries."""
        return self.indptr[:-1]

    def assemble(self, state: Floats, out: Floats, *, geometric: float = 1.0) -> None:
        """Assemble at owned position dofs (collective).

        Args:
            state: Owned position dofs.
            out: Receives the entries, in the order of `columns`.
            geometric: 1 for K; 0 for its material part M, positive semidefinite.
        """
        self._model.tangent_entries(state, self._entries, geometric)
        sums = self._sum @ self._entries
        comm: MPI.Comm = self._model.skin.comm
        if comm.size == 1:
            out[:] = sums
            return
        incoming = np.empty(self._receive.sum())
        comm.Alltoallv([sums[self._outgoing], self._send], [incoming, self._receive])
        out[:] = np.bincount(
            self._incoming_places, weights=incoming, minlength=len(out)
        )
        out[self._own_places] += sums[self._own]


def _contributions(model: SkinModel) -> tuple[Ints, Floats]:
    """For each number an assembly starts from, its entry row · size + column, −1 if it has none.

    The numbers are those of `SkinModel.tangent_entries`, then a 1 for each held dof. The second
    array holds their weights: where a patch meets one vertex twice, (i, j) and (j, i) coincide.
    """
    index_map = model.space.dofmap.index_map
    size = index_map.size_global
    local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    number = index_map.local_to_global(local)
    place, dofs, present = model.tangent_layout
    row, column = np.triu_indices(dofs.shape[1])
    shape = (len(place), len(row))
    keys = np.full(shape, -1, dtype=np.int64)
    weights = np.ones(shape)
    counts = ~np.append(model.held, True)[np.where(present, dofs, -1)]
    numbers = number[dofs]
    for n, (i, j) in enumerate(zip(row, column, strict=True)):
        a, b = numbers[:, i], numbers[:, j]
        entry = np.minimum(a, b) * size + np.maximum(a, b)
        keys[place, n] = np.where(counts[:, i] & counts[:, j], entry, -1)
        if i != j:
            weights[place, n] = np.where(a == b, 2.0, 1.0)
    held = number[np.flatnonzero(~model.free)]
    return (
        np.concatenate([keys.ravel(), held * (size + 1)]),
        np.concatenate([weights.ravel(), np.ones(len(held))]),
    )
