"""Upper triangle of the tangent, summed from element entries by a map that is made once."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy.sparse import csc_matrix, csr_matrix

from toros_fem.base.array_types import Floats, Ints, LocalInts
from toros_fem.mechanics.assembly.block_pairs import BlockPairs
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.assembly.periodic_tangent import PeriodicTangent


class UpperTangent:
    """Second variation of E in N/m, entries (i, j) with i ≤ j of the rows this rank owns.

    The tangent is symmetric, so its lower half is neither computed nor kept. Each triangle gives
    the upper triangle of its element matrix. The map from these numbers to the entries is made
    once, for the model's further pairs of that time, so that assembly is one sum and, on several
    ranks, one exchange. Fixed rows and columns are those of the identity.

    Attributes:
        indptr, columns: Compressed rows: columns are global, sorted, the diagonal comes first.
        periodic: The rows of F̄; None for a skin that does not repeat.
        blocks: Pairs of blocks of the triangles.

    Args:
        model: The skin's model.
        blocks: Its pairs of blocks, which outlive the further pairs; None finds them.
    """

    def __init__(self, model: SkinModel, blocks: BlockPairs | None = None) -> None:
        self._model = model
        comm = model.skin.comm
        index_map = model.space.dofmap.index_map
        size = index_map.size_global
        starts = np.array(comm.allgather(index_map.local_range[0]) + [size], dtype=np.int64)
        self.periodic: PeriodicTangent | None = None
        if model.images is not None:
            self.periodic = PeriodicTangent(model, model.images)
        self.blocks = blocks = blocks or BlockPairs(model)
        self._generation = model.generation
        further_pairs = model.further_pairs
        more = further_pairs[0] * size + further_pairs[1]
        fixed = index_map.local_to_global(np.flatnonzero(~model.free).astype(np.int32))
        further = [more, fixed * (size + 1)]
        if self.periodic is not None:
            further.append(self.periodic.keys)
        keys = np.concatenate(further)
        self._own = blocks.count + len(more) + len(fixed)

        entry, place = _with(blocks.keys, keys)
        # Entries are sorted by row, so those of one owner are neighbours.
        bounds = np.searchsorted(entry, starts * size)
        begin, end = bounds[comm.rank], bounds[comm.rank + 1]
        send = np.diff(bounds)
        send[comm.rank] = 0
        receive = np.array(comm.alltoall(list(send)), dtype=np.int64)
        incoming = np.empty(receive.sum(), dtype=np.int64)
        others = np.append(entry[:begin], entry[end:])
        comm.Alltoallv([others, send], [incoming, receive])
        merged, own_place = _with(entry[begin:end], incoming)
        self._send, self._receive = send, receive
        self._places = np.split(np.searchsorted(merged, incoming), np.cumsum(receive)[:-1])

        # What a rank sends follows its own entries, and last is one for numbers without an entry.
        final = np.arange(len(merged), len(merged) + len(entry) + 1)
        final[end:] -= end - begin
        final[begin:end] = own_place
        places = np.append(
            blocks.places(final[np.append(place, -1)]),
            final[np.searchsorted(entry, keys)].astype(np.int32),
        )
        # Where a patch meets one vertex twice, (i, j) and (j, i) coincide and count 2.
        self._twice = blocks.twice
        if self.periodic is not None:
            periodic = self._own + np.flatnonzero(self.periodic.weights == 2)
            self._twice = np.append(self._twice, periodic)

        first, last = index_map.local_range
        self.indptr = np.searchsorted(merged, np.arange(first, last + 1) * size).astype(np.int32)
        self.columns = (merged % size).astype(np.int32)
        # Fixed dofs stand last among the model's own and keep their 1; those of F̄ follow.
        self._entries: Floats = np.ones(len(places))
        # All numbers in one column: its product with 1 sums those of one place.
        whole = np.array([0, len(places)])
        shape = (len(merged) + int(send.sum()) + 1, 1)
        self._sum = csc_matrix((self._entries, places, whole), shape=shape, copy=False)
        self._set_up_product(starts)

    def _set_up_product(self, starts: Ints) -> None:
        """Number the columns that this rank meets, owned ones first, and plan their exchange."""
        comm, columns = self._model.skin.comm, self.columns
        begin, end = starts[comm.rank : comm.rank + 2]
        own = (columns >= begin) & (columns < end)
        others = np.unique(columns[~own]).astype(np.int64)
        self._local = columns
        if comm.size > 1:
            place = end - begin + np.searchsorted(others, columns)
            self._local = np.where(own, columns - begin, place).astype(np.int32)
        self._needed = np.diff(np.searchsorted(others, starts))
        self._lent = np.array(comm.alltoall(list(self._needed)), dtype=np.int64)
        wanted = np.empty(self._lent.sum(), dtype=np.int64)
        comm.Alltoallv([others, self._needed], [wanted, self._lent])
        self._wanted = wanted - begin

    @property
    def outgrown(self) -> bool:
        """Whether the further pairs are others than when the map was made."""
        return self._generation != self._model.generation

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
        self._entries[self._twice] *= 2
        self._add_up(out)

    def convexity_gap(self, state: Floats, out: Floats) -> bool:
        """Assemble what makes the contact's part positive semidefinite (collective).

        Args:
            state: Owned unknowns.
            out: Receives the entries, in the order of `columns`, if there are any.

        Returns:
            Whether anything is in contact.
        """
        contact = self._model.contact
        gap = None if contact is None else contact.convexity_gap(state)
        if gap is None:
            return False
        assert contact is not None
        kept, begin = self._entries.copy(), self.blocks.count + self._model.first_entry(contact)
        self._entries[:] = 0
        self._entries[begin : begin + len(gap)] = gap
        self._add_up(out)
        self._entries[:] = kept
        return True

    def _add_up(self, out: Floats) -> None:
        """Sum the entries into `out`, those of other ranks included (collective)."""
        comm: MPI.Comm = self._model.skin.comm
        sums = (self._sum @ np.ones(1))[:-1]
        out[:] = sums[: len(out)]
        if comm.size > 1:
            incoming = np.empty(self._receive.sum())
            comm.Alltoallv([sums[len(out) :], self._send], [incoming, self._receive])
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


def _with(known: Ints, more: Ints) -> tuple[Ints, Ints]:
    """Return the union of sorted distinct keys with others, and the new places of the known."""
    more = np.unique(more)
    place = np.searchsorted(known, more)
    new = np.append(known, -1)[place] != more
    ahead = np.cumsum(np.bincount(place[new], minlength=len(known) + 1)[: len(known)])
    return np.insert(known, place[new], more[new]), np.arange(len(known)) + ahead
