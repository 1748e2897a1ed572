"""Upper triangle of the tangent, summed from element entries by a map that is made once."""

from __future__ import annotations

from itertools import product

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from scipy.sparse import csc_matrix, csr_matrix

from toros_fem.base.fenicsx import work_vector
from toros_fem.base.validation import Bools, Floats, Ints, LocalInts
from toros_fem.mechanics.terms.model import SkinModel
from toros_fem.mechanics.terms.periodic import Images

# Triangles treated at once: the work arrays stay in the processor's cache.
CHUNK = 2000
# Parts of the second variation: factors on the geometric stiffness of strains and loads, on that of
# angles, and on that of contact. What a term has left with 0 is positive semidefinite.
EXACT, CONVEX, STRAINS, MATERIAL = (1.0, 1.0, 1.0), (1.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0,) * 3
Part = tuple[float, float, float]


class TriangleMatrices:
    """Upper triangles of the matrices of owned triangles, and what terms add: ∂²E in N/m.

    Attributes:
        rows: Row of each owned triangle among the entries.
        dofs: Its local unknowns, (n, 9), (n, 18) or (n, 21).
        present: Whether each of them exists, of that shape: a flap may be missing.
        count: Number of entries of the triangles, 45, 171 or 231 of each.
    """

    def __init__(self, model: SkinModel) -> None:
        self._model, owned = model, len(model.skin.owned_cells)
        self.rows: LocalInts = model.entry_space.dofmap.list[:owned, 0]
        self.dofs: LocalInts = model.space.dofmap.list[:owned, : model.patch.components]
        self.present: Bools = np.ones(self.dofs.shape, dtype=bool)
        if model.bend is not None:
            seen = model.bend.hinges.has_moment[:owned]
            self.present[:, 9:18] = np.repeat(seen, 3, axis=1)
        self.count = owned * model.entry_space.dofmap.bs
        self._form = model.compiled("tangent", lambda forms: forms.tangent)

    def compute(self, state: Floats, out: Floats, part: Part = EXACT) -> None:
        """Write the entries of the triangles at a state, and those of the terms behind them."""
        model, begin = self._model, self.count
        model.set_state(state)
        model.geometric.value[:] = part[:2]
        out[:begin] = 0
        fem.assemble_vector(out, self._form)
        for term in model.terms:
            kept = part[2] if term is model.contact else part[0]
            more = term.entries(state, definite=kept == 0)
            out[begin : begin + len(more)] = more
            begin += len(more)


class UpperTangent:
    """Second variation of E in N/m, entries (i, j) with i ≤ j of the rows this rank owns.

    The tangent is symmetric, so its lower half is neither computed nor kept. Each triangle gives
    the upper triangle of its element matrix. The map from these numbers to the entries is made
    once, and again where terms `grow`, so that assembly is one sum and, on several ranks, one
    exchange. Fixed rows and columns are those of the identity.

    Attributes:
        indptr, columns: Compressed rows: columns are global, sorted, the diagonal comes first.
        triangles: Matrices of the triangles.
        periodic: The rows of F̄; None for a skin that does not repeat.
    """

    def __init__(self, model: SkinModel) -> None:
        self._model, self.triangles = model, TriangleMatrices(model)
        self.periodic: PeriodicTangent | None = None
        if model.images is not None:
            self.periodic = PeriodicTangent(model, model.images, self.triangles)
        blocks = BlockPairs(model, self.triangles)
        self._twice = blocks.twice
        self._make_map(blocks)
        # Only contact adds entries later. The pairs take as much memory as the map.
        self._blocks = None if model.contact is None else blocks

    def grow(self, state: Floats) -> bool:
        """Let the entries cover what acts at a state; return whether they are others now."""
        for term in self._model.terms:
            term.grow(state)
        grown = self._generation != sum(term.generation for term in self._model.terms)
        if grown:
            assert self._blocks is not None
            self._make_map(self._blocks)
        return grown

    def _make_map(self, blocks: BlockPairs) -> None:
        """Find the entries, and the place of each number among them (collective)."""
        model, comm = self._model, self._model.skin.comm
        index_map = model.space.dofmap.index_map
        size = index_map.size_global
        starts = np.array(comm.allgather(index_map.local_range[0]) + [size], dtype=np.int64)
        self._generation = sum(term.generation for term in model.terms)
        rows, of_rows = np.hstack([term.pairs for term in model.terms])
        more = rows * size + of_rows
        fixed = index_map.local_to_global(np.flatnonzero(~model.free).astype(np.int32))
        further = [more, fixed * (size + 1)]
        if self.periodic is not None:
            further.append(self.periodic.keys)
        keys = np.concatenate(further)
        self._own = self.triangles.count + len(more) + len(fixed)

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
    def diagonal(self) -> LocalInts:
        """Positions of the diagonal among the entries."""
        return self.indptr[:-1]

    def assemble(self, state: Floats, out: Floats, part: Part = EXACT) -> None:
        """Write the entries of a part at a state, in the order of `columns` (collective)."""
        self.triangles.compute(state, self._entries, part)
        if self.periodic is not None:
            self._entries[self._own :] = self.periodic.values(self._entries, part)
        # Where a patch meets one vertex twice, (i, j) and (j, i) coincide and count 2.
        self._entries[self._twice] *= 2
        self._add_up(out)

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
        """Return K x from the entries of K and owned unknowns (collective)."""
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


def symmetric(upper: Floats, size: int) -> Floats:
    """Return whole matrices, (n, size, size), from the rows of their upper triangles, (n, p)."""
    row, column = np.triu_indices(size)
    matrices = np.zeros((len(upper), size, size))
    matrices[:, row, column] = matrices[:, column, row] = upper
    return matrices


class PeriodicTangent:
    """Tangent entries at the columns of F̄, from the matrices of triangles that see images.

    A triangle's matrix A belongs to the places where it sees its nodes, x + a F̄n + b F̄t. The
    matrix of the unknowns is EᵀAE with E = (1, S), S by the factors a, b of each node. The part of
    the 1 is that of all triangles; A S and SᵀA S are added here.

    Attributes:
        keys: Entry row · size + column of each number, row ≤ column.
    """

    def __init__(self, model: SkinModel, images: Images, triangles: TriangleMatrices) -> None:
        self._images, self._vector = images, work_vector(model.space)
        self._cells = cells = np.flatnonzero(images.images.any(axis=1))
        self._dofs, self._present = triangles.dofs[cells], triangles.present[cells]
        count = self._dofs.shape[1]
        of_each = count * (count + 1) // 2
        first = triangles.rows[cells].astype(np.int64) * of_each
        self._entries = first[:, None] + np.arange(of_each)
        # A S of each triangle has rows of its unknowns and columns of F̄; SᵀA S is symmetric.
        index_map = model.space.dofmap.index_map
        local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        number = np.where(model.fixed, -1, index_map.local_to_global(local))
        own = np.where(self._present, number[self._dofs], -1)
        columns = number[images.dofs].ravel()
        self._upper = np.triu_indices(len(columns))
        rows = np.append(np.repeat(own, len(columns)), np.tile(columns[self._upper[0]], len(cells)))
        others = np.append(np.tile(columns, own.size), np.tile(columns[self._upper[1]], len(cells)))
        self._kept = np.flatnonzero((rows >= 0) & (others >= 0))
        pairs = rows[self._kept], others[self._kept]
        self.keys: Ints = np.minimum(*pairs) * np.int64(index_map.size_global) + np.maximum(*pairs)

    def _products(self, entries: Floats) -> tuple[Floats, Floats]:
        """A S, (cells, n, 6), and SᵀA S, (cells, 6, 6), from the entries of the triangles."""
        count = self._dofs.shape[1]
        matrix = symmetric(entries[self._entries], count)
        matrix *= self._present[:, :, None] & self._present[:, None, :]
        shifts = self._images.shifts[self._cells]
        by_node = np.zeros((len(self._cells), count // 3, 3, 2, 3))
        for k in range(3):
            by_node[:, : shifts.shape[1], k, :, k] = shifts
        S = by_node.reshape(len(by_node), count, 6)
        product = matrix @ S
        return product, S.transpose(0, 2, 1) @ product

    def values(self, entries: Floats, part: Part) -> Floats:
        """Return the numbers that belong to `keys`, from the entries of the triangles."""
        product, square = self._products(entries)
        if part == EXACT:
            self._last = product, square
        upper = square[:, self._upper[0], self._upper[1]]
        return np.append(product, upper)[self._kept]

    def force(self, change: Floats) -> Floats:
        """Return the change of the first variation, at all owned unknowns, by F̄ alone (collective).

        It is that of the tangent that was assembled last; `change` is that of F̄, (3, 2).
        """
        along = self._images.periodic.length * np.asarray(change).T.ravel()
        product, square = self._last
        out = self._vector.array
        out[:] = 0
        np.add.at(out, self._dofs, product @ along)
        np.add.at(out, self._images.dofs.ravel(), (square @ along).sum(axis=0))
        self._vector.scatter_reverse(la.InsertMode.add)
        return np.array(out[: self._vector.index_map.size_local])


class BlockPairs:
    """Pairs of blocks that a triangle sees together, and the entries of the tangent in them.

    A block is the position of a vertex, three unknowns, or the rotation of an edge. A patch has 21
    unknowns and 231 pairs of them, but only 9 blocks and 45 pairs: these alone are sorted.

    Attributes:
        keys: Entry row · size + column of the tangent's upper triangle, in global unknowns, without
            fixed ones; sorted and distinct.
        twice: Entries of the triangles at which (i, j) and (j, i) coincide, because a patch meets
            one vertex twice.
    """

    def __init__(self, model: SkinModel, triangles: TriangleMatrices) -> None:
        index_map = model.space.dofmap.index_map
        local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        number = index_map.local_to_global(local)
        self._row, dofs, present = triangles.rows, triangles.dofs, triangles.present
        unknowns = dofs.shape[1]
        nodes = 3 if model.bend is None else 6
        first = np.append(np.arange(0, 3 * nodes, 3), np.arange(3 * nodes, unknowns))
        width = np.where(first < 3 * nodes, 3, 1)
        u, v = np.triu_indices(len(first))

        # Blocks are numbered in the order of their global unknowns.
        begin = np.unique(dofs[:, first])
        begin = begin[np.argsort(number[begin])]
        block_of = np.zeros(len(local), dtype=np.int32)
        block_of[begin] = np.arange(len(begin))
        blocks = block_of[dofs[:, first]]
        free = np.zeros((len(begin), 3), dtype=bool)
        for k, (dof, count) in enumerate(zip(first, width, strict=True)):
            free[blocks[:, k], :count] = ~model.fixed[dofs[:, dof : dof + count]]

        one, two = blocks[:, u], blocks[:, v]
        seen = present[:, first]
        seen_both = seen[:, u] & seen[:, v]
        pairs = np.minimum(one, two) * np.int64(len(begin)) + np.maximum(one, two)
        pairs[~seen_both] = len(begin) ** 2  # after all others
        known, pair = np.unique(pairs, return_inverse=True)
        known = known[: np.searchsorted(known, len(begin) ** 2)]
        # Those that a triangle sees the other way round are a second set, absent ones are last.
        pair = pair.reshape(pairs.shape) + len(known) * (one > two)
        self._pair = np.where(seen_both, pair, 2 * len(known)).astype(np.int32)
        low, high = np.divmod(known, len(begin))

        used = free[low][:, :, None] & free[high][:, None, :]
        diagonal = np.flatnonzero(low == high)
        used[diagonal] &= np.triu(np.ones((3, 3), dtype=bool))
        slots, count = _ranks(used, low, len(begin))
        slots[~used] = count
        keys: Ints = np.empty(count + 1, dtype=np.int64)
        corner = number[begin[low]] * index_map.size_global + number[begin[high]]
        for k, m in product(range(3), repeat=2):
            keys[slots[:, k, m]] = corner + k * index_map.size_global + m
        self.keys = keys[:count]
        # Both halves of a block on the diagonal lead to its upper one.
        upper = slots[diagonal]
        slots[diagonal] = np.minimum(upper, upper.transpose(0, 2, 1))
        self._slots = slots

        # Pair of blocks, and row and column inside it, of each pair of unknowns i ≤ j.
        i, j = np.triu_indices(unknowns)
        block = np.repeat(np.arange(len(first)), width)
        inside = np.arange(unknowns) - first[block]
        pair_number: Ints = np.zeros((len(first), len(first)), dtype=np.int64)
        pair_number[u, v] = np.arange(len(u))
        self._pair_of = pair_number[block[i], block[j]]
        self._slot_of = 9 * self._pair_of + 3 * inside[i] + inside[j]
        met, pair_met = np.nonzero((one == two) & seen_both & (u != v))
        again = (self._pair_of == pair_met[:, None]) & (inside[i] == inside[j])
        meeting, entry = np.nonzero(again)
        self.twice: Ints = self._row[met[meeting]].astype(np.int64) * len(i) + entry

    def places(self, of_key: Ints) -> LocalInts:
        """Return the place of each entry of the triangles, from those of the keys.

        Entries without a key have one more, the last.
        """
        slots = self._slots
        table = np.empty((2 * len(slots) + 1, 3, 3), dtype=np.int32)
        table[: len(slots)] = of_key[slots]
        table[len(slots) : -1] = table[: len(slots)].transpose(0, 2, 1)
        table[-1] = of_key[-1]
        out = np.empty((len(self._row), len(self._slot_of)), dtype=np.int32)
        for begin in range(0, len(out), CHUNK):
            part = slice(begin, begin + CHUNK)
            seen = table[self._pair[part]].reshape(-1, 9 * self._pair.shape[1])
            out[self._row[part]] = seen[:, self._slot_of]
        return out.ravel()


def _ranks(used: Bools, low: Ints, blocks: int) -> tuple[LocalInts, int]:
    """Return the rank of each used slot, (p, 3, 3), by row, then by pair, and the number of them.

    `low` is the first block of each pair, (p,), ascending.
    """
    ranks = np.zeros(used.shape, dtype=np.int32)
    ranks[:, :, 1] = used[:, :, 0]
    ranks[:, :, 2] = ranks[:, :, 1] + used[:, :, 1]
    ahead = np.zeros((len(used) + 1, 3), dtype=np.int64)
    np.cumsum(ranks[:, :, 2] + used[:, :, 2], axis=0, out=ahead[1:])
    bounds = ahead[np.searchsorted(low, np.arange(blocks + 1))]
    length = np.diff(bounds, axis=0).ravel()
    start = (np.cumsum(length) - length).reshape(-1, 3)
    ranks += ((start - bounds[:-1])[low] + ahead[:-1]).astype(np.int32)[:, :, None]
    return ranks, int(length.sum())
