"""Upper triangle of the tangent, summed from element entries by a map that is made once."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix

from toros_fem._types import Bools, Floats, Ints, LocalInts
from toros_fem.mechanics.model import SkinModel
from toros_fem.mechanics.periodic_tangent import PeriodicTangent
from toros_fem.mechanics.periodicity import PeriodicModel


class UpperTangent:
    """Second variation of E in N/m, entries (i, j) with i ≤ j of the rows this rank owns.

    The tangent is symmetric, so its lower half is neither computed nor kept. Each triangle gives
    the upper triangle of its element matrix. The map from these numbers to the entries never
    changes, so that assembly is one sparse product and, on several ranks, one exchange. Fixed rows
    and columns are those of the identity.

    Attributes:
        indptr, columns: Compressed rows: columns are global, sorted, the diagonal comes first.
        periodic: The rows of F̄; None for a skin that does not repeat.

    Args:
        model: The skin's model.
    """

    def __init__(self, model: SkinModel) -> None:
        self._model = model
        comm = model.skin.comm
        index_map = model.space.dofmap.index_map
        size = index_map.size_global
        starts = np.array(comm.allgather(index_map.local_range[0]) + [size], dtype=np.int64)
        keys, weights = _contributions(model)
        self._own = len(keys)
        self.periodic = PeriodicTangent(model) if isinstance(model, PeriodicModel) else None
        if self.periodic is not None:
            keys = np.append(keys, self.periodic.keys)
            weights = np.append(weights, self.periodic.weights)

        order = np.argsort(keys, kind="stable")
        order = order[np.searchsorted(keys[order], 0) :]
        first = np.flatnonzero(np.diff(keys[order], prepend=-1))
        entry = keys[order][first]

        # Entries are sorted by row, so those of one owner are neighbours.
        bounds = np.searchsorted(entry, starts * size)
        mine = np.zeros(len(entry), dtype=bool)
        mine[bounds[comm.rank] : bounds[comm.rank + 1]] = True
        send = np.diff(bounds)
        send[comm.rank] = 0
        receive = np.array(comm.alltoall(list(send)), dtype=np.int64)
        incoming = np.empty(receive.sum(), dtype=np.int64)
        comm.Alltoallv([entry[~mine], send], [incoming, receive])
        merged = np.union1d(entry[mine], incoming)
        self._send, self._receive = send, receive
        places = np.searchsorted(merged, incoming)
        self._places = np.split(places, np.cumsum(receive)[:-1])

        counts = np.diff(np.append(first, len(order)))

        def sums(rows: Ints, chosen: Bools, total: int) -> csr_matrix:
            used = np.repeat(chosen, counts)
            lengths: Ints = np.zeros(total, dtype=np.int64)
            lengths[rows] = counts[chosen]
            parts = (weights[order[used]], order[used], np.append(0, np.cumsum(lengths)))
            return csr_matrix(parts, shape=(total, len(keys)))

        self._sum = sums(np.searchsorted(merged, entry[mine]), mine, len(merged))
        self._sum_out = sums(np.arange((~mine).sum()), ~mine, int((~mine).sum()))

        begin, end = index_map.local_range
        self.indptr = np.searchsorted(merged, np.arange(begin, end + 1) * size).astype(np.int32)
        self.columns = (merged % size).astype(np.int32)
        # Fixed dofs stand last among the model's own and keep their 1; those of F̄ follow.
        self._entries: Floats = np.ones(len(keys))
        self._set_up_product(merged % size, starts)

    def _set_up_product(self, columns: Ints, starts: Ints) -> None:
        """Number the columns that this rank meets, owned ones first, and plan their exchange."""
        comm = self._model.skin.comm
        begin, end = starts[comm.rank : comm.rank + 2]
        others = np.unique(columns[(columns < begin) | (columns >= end)])
        place = end - begin + np.searchsorted(others, columns)
        own = (columns >= begin) & (columns < end)
        self._local = np.where(own, columns - begin, place).astype(np.int32)
        self._needed = np.diff(np.searchsorted(others, starts))
        self._lent = np.array(comm.alltoall(list(self._needed)), dtype=np.int64)
        wanted = np.empty(self._lent.sum(), dtype=np.int64)
        comm.Alltoallv([others, self._needed], [wanted, self._lent])
        self._wanted = wanted - begin

    @property
    def diagonal(self) -> LocalInts:
        """Positions of the diagonal among the entries."""
        return self.indptr[:-1]

    def assemble(self, state: Floats, out: Floats, *, geometric: float = 1.0) -> None:
        """Assemble at a state (collective).

        Args:
            state: Owned unknowns.
            out: Receives the entries, in the order of `columns`.
            geometric: 1 for K; 0 for its material part M, positive semidefinite.
        """
        self._model.tangent_entries(state, self._entries, geometric)
        if self.periodic is not None:
            self._entries[self._own :] = self.periodic.values(self._entries)
        out[:] = self._sum @ self._entries
        comm: MPI.Comm = self._model.skin.comm
        if comm.size > 1:
            incoming = np.empty(self._receive.sum())
            comm.Alltoallv([self._sum_out @ self._entries, self._send], [incoming, self._receive])
            ends = np.cumsum(self._receive)[:-1]
            for places, part in zip(self._places, np.split(incoming, ends), strict=True):
                out[places] += part  # those of one rank are distinct

    def multiply(self, entries: Floats, x: Floats) -> Floats:
        """Return K x from the upper triangle of K (collective).

        Args:
            entries: As `assemble` returns them.
            x: Owned unknowns.
        """
        comm, size = self._model.skin.comm, len(x)
        shape = (size, size + self._needed.sum())
        upper = csr_matrix((entries, self._local, self.indptr), shape=shape, copy=False)
        whole = x
        if comm.size > 1:
            whole = np.empty(shape[1])
            whole[:size] = x
            comm.Alltoallv([x[self._wanted], self._lent], [whole[size:], self._needed])
        lower = upper.T @ x
        result = upper @ whole + lower[:size] - entries[self.diagonal] * x
        if comm.size > 1:
            incoming = np.empty(self._lent.sum())
            comm.Alltoallv([lower[size:], self._needed], [incoming, self._lent])
            result += np.bincount(self._wanted, incoming, minlength=size)
        return np.asarray(result)


def _contributions(model: SkinModel) -> tuple[Ints, Floats]:
    """Return the entry row · size + column of each number that is assembled, −1 for none.

    The numbers are those of `SkinModel.tangent_entries`, of triangles and of walls, then a 1 for
    each fixed dof. The second array holds their weights: where a patch meets one vertex twice,
    (i, j) and (j, i) coincide and count 2.
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
    counts = ~np.append(model.fixed, True)[np.where(present, dofs, -1)]
    numbers = number[dofs]
    for n, (i, j) in enumerate(zip(row, column, strict=True)):
        a, b = numbers[:, i], numbers[:, j]
        entry = np.minimum(a, b) * size + np.maximum(a, b)
        keys[place, n] = np.where(counts[:, i] & counts[:, j], entry, -1)
        if i != j:
            weights[place, n] = np.where(a == b, 2.0, 1.0)
    walls = model.wall_pairs[0] * size + model.wall_pairs[1]
    fixed = number[np.flatnonzero(~model.free)]
    return (
        np.concatenate([keys.ravel(), walls, fixed * (size + 1)]),
        np.concatenate([weights.ravel(), np.ones(len(walls) + len(fixed))]),
    )
