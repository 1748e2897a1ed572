"""Cholesky factors of a matrix in parts that meet at an interface: static condensation.

Each part eliminates its own unknowns by itself, on its rank or thread. What remains is a small
dense matrix of the interface, the Schur complement. A skin is slender, so that few unknowns lie
between two halves of it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.linalg import lapack
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from toros_fem.base.array_types import Bools, Floats, Ints, LocalInts
from toros_fem.base.errors import TorosError
from toros_fem.base.mpi import raise_together, sum_over_ranks, together
from toros_fem.mechanics.equilibrium.cholmod import Cholmod

# Fewer unknowns than these are not worth a thread of their own.
LEAST_PART = 5000


@dataclass(frozen=True, eq=False)
class Partition:
    """Parts of the unknowns, the same on all ranks.

    Attributes:
        part: Part of each unknown, by its global number.
        parts: Number of parts: that of the ranks, or of the threads of one rank.
        interface: Numbers of the interface's unknowns, sorted: without these no entry joins two
            parts.
    """

    part: Ints
    parts: int
    interface: Ints


def find_partition(
    comm: MPI.Comm, cholmod: Cholmod, indptr: LocalInts, columns: LocalInts, *, threads: int
) -> Partition:
    """Find the parts of a matrix of `CondensedFactor`: one for each rank, or thread of one rank."""
    sizes = np.array(comm.allgather(len(indptr) - 1), dtype=np.int64)
    if comm.size > 1:
        part, parts = np.repeat(np.arange(comm.size), sizes), comm.size
    else:
        part = _split(cholmod, indptr, columns, threads)
        parts = int(part.max(initial=0)) + 1
    rows = sizes[: comm.rank].sum() + np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    across = np.flatnonzero(part[rows] != part[columns])
    pairs = np.stack([rows[across], columns[across].astype(np.int64)], axis=1)
    return Partition(part, parts, _cover(np.concatenate(comm.allgather(pairs)), part))


class CondensedFactor:
    """Factors of a symmetric matrix whose rows are distributed; all methods are collective.

    With I the inner unknowns of a part and B those of the interface that it touches, the part
    factorises the principal submatrix of I and B. B comes last, so that its corner of L holds
    L_BB L_BBᵀ = K_BB − K_BI K_II⁻¹ K_IB. The Schur complement is the interface's own matrix less
    K_BI K_II⁻¹ K_IB of all parts; each rank factorises it. The whole matrix is positive definite
    if and only if all of these are.

    The matrix is given by the upper triangle of the owned rows: `indptr` and global `columns`,
    sorted, the diagonal first.

    Attributes:
        parts: Number of parts on all ranks.
        interface: Global numbers of the interface's unknowns.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        cholmod: Cholmod,
        indptr: LocalInts,
        columns: LocalInts,
        partition: Partition,
    ) -> None:
        self._comm, self.parts, self.interface = comm, partition.parts, partition.interface
        size = len(indptr) - 1
        starts = np.append(0, np.cumsum(comm.allgather(size)))
        begin = int(starts[comm.rank])
        # The lists of entries are the largest arrays of a set-up: numbers have four bytes in them.
        part = partition.part.astype(np.int32)
        rows = np.repeat(np.arange(begin, begin + size, dtype=np.int32), np.diff(indptr))
        numbers = [comm.rank] if comm.size > 1 else range(partition.parts)
        count = len(self.interface)
        at = np.full(starts[-1], -1, dtype=np.int32)
        at[self.interface] = np.arange(count)

        # Entries in a row of the interface may belong to any part: all ranks get them.
        on = (at[rows] >= 0) & ((at[columns] >= 0) | (part[columns] != part[rows]))
        self._shared = np.flatnonzero(on)
        self._counts = np.array(comm.allgather(len(self._shared)), dtype=np.int64)
        shared = np.concatenate(comm.allgather(np.stack([rows[on], columns[on]], axis=1)))
        corner = np.flatnonzero((at[shared] >= 0).all(axis=1))
        self._corner = np.sort(at[shared[corner]], axis=1), corner

        mine = at[begin : begin + size]
        self._own = np.flatnonzero(mine >= 0), mine[mine >= 0]
        keep, zero = np.flatnonzero(~on).astype(np.int32), len(rows) + len(shared)
        entries = np.empty((3, len(keep) + len(shared)), dtype=np.int32)
        entries[:, len(keep) :] = [*shared.T, np.arange(len(rows), zero)]
        for place, own in enumerate((rows[keep], columns[keep], keep)):
            entries[place, : len(keep)] = own
        del on, keep, rows, columns
        self._values = np.zeros(zero + 1)
        with together(comm):
            self._parts = [
                _Part(cholmod, np.flatnonzero((part == p) & (at < 0)), at, entries, zero, begin)
                for p in numbers
            ]
        self._pool = ThreadPoolExecutor(len(self._parts)) if len(self._parts) > 1 else None
        self._schur: Floats = np.zeros((count, count))

    def factorise(self, values: Floats) -> bool:
        """Factorise for the entries of the owned rows; return whether all is positive definite."""
        comm, count = self._comm, len(self.interface)
        self._values[: len(values)] = values
        shared = self._values[len(values) : -1]
        comm.Allgatherv(values[self._shared], [shared, self._counts])
        good, error = False, None
        try:
            good = all(self._each(lambda part: part.factorise(self._values)))
        except TorosError as caught:
            error = caught
        if self.parts == 1:
            raise_together(comm, error)
            return good
        # One sum over the ranks tells whether all succeeded, and adds what remains.
        total: Floats = np.zeros(count * count + 1)
        square = total[:-1].reshape(count, count)
        total[-1] = float(not good)
        if good and count:
            for part in self._parts:
                square[np.ix_(part.place, part.place)] += part.schur()
        comm.Allreduce(MPI.IN_PLACE, total)
        if total[-1]:
            raise_together(comm, error)
            return False
        if not count:
            return True
        (row, column), source = self._corner[0].T, self._corner[1]
        square[row, column] += shared[source]
        self._schur, info = lapack.dpotrf(square.T, lower=1, clean=0, overwrite_a=1)
        return bool(comm.bcast(info == 0))

    def solve(self, rhs: Floats) -> Floats:
        """Solve with the last factors, for and at the owned unknowns."""
        comm, count = self._comm, len(self.interface)
        forces = self._each(lambda part: part.condense(rhs))
        at_interface: Floats = np.zeros(count)
        if count:
            local, place = self._own
            at_interface[place] = rhs[local]
            for part, share in zip(self._parts, forces, strict=True):
                at_interface[part.place] += share
            at_interface = sum_over_ranks(comm, at_interface)
            at_interface = lapack.dpotrs(self._schur, at_interface, lower=1)[0]
        out = np.empty(len(rhs))
        self._each(lambda part: part.expand(at_interface, out))
        if count:
            out[local] = at_interface[place]
        return out

    def _each(self, action: Any) -> list[Any]:
        if self._pool is None:
            return [action(part) for part in self._parts]
        return list(self._pool.map(action, self._parts))


class _Part:
    """Inner unknowns of one part, with its interface behind them in reversed order.

    `inner` are their global numbers, `begin` the first one of this rank, and `at` the place of each
    global number in the interface, −1 for none. Entries have global rows and columns, and the
    place of their value, (3, k); `zero` is that of a zero.

    Attributes:
        place: Places in the interface that the part touches.
    """

    def __init__(
        self,
        cholmod: Cholmod,
        inner: Ints,
        at: LocalInts,
        entries: LocalInts,
        zero: int,
        begin: int,
    ) -> None:
        size, (rows, columns, source) = len(inner), entries
        number: LocalInts = np.full(len(at), -1, dtype=np.int32)
        number[inner] = np.arange(size)
        # Only what the part touches of the interface.
        one, two = number[rows] >= 0, number[columns] >= 0
        touched = columns[one & (at[columns] >= 0)], rows[two & (at[rows] >= 0)]
        edge = np.unique(np.append(*touched))
        self.place, count = at[edge], len(edge)
        chosen = np.flatnonzero(one & two)
        order = cholmod.order(*_lower(number[rows[chosen]], number[columns[chosen]], size)[:2])
        self._inner, self._count = inner[order] - begin, count
        number[inner[order]] = np.arange(size)
        number[edge] = size + np.arange(count)[::-1]
        i, j = number[rows], number[columns]
        chosen = np.flatnonzero((i >= 0) & (j >= 0) & ((i < size) | (j < size)))
        pointers, lower, place = _lower(i[chosen], j[chosen], size)
        # The corner fills up anyway; as a dense pattern it is sure to stay last in one piece.
        corner = np.flatnonzero((i >= size) & (j >= size))
        dense: Ints = np.full((count, count), zero)
        dense[np.minimum(i, j)[corner] - size, np.maximum(i, j)[corner] - size] = source[corner]
        upper = np.triu_indices(count)
        self._source = np.append(source[chosen][place], dense[upper]).astype(np.intp)
        lower = np.append(lower, (size + upper[1]).astype(np.int32))
        ends = pointers[-1] + np.cumsum(np.arange(count, 0, -1))
        pointers = np.append(pointers, ends.astype(np.int32))
        self.factor = cholmod.factor(pointers, lower)
        self._entries: Floats = np.zeros(len(lower))
        self._corner: Floats = np.zeros((count, count))

    def factorise(self, values: Floats) -> bool:
        np.take(values, self._source, out=self._entries, mode="clip")
        good = self.factor.factorise(self._entries)
        if good and self._count:
            self._corner = self.factor.corner(self._count)
        return good

    def schur(self) -> Floats:
        """Return −K_BI K_II⁻¹ K_IB of the part, the upper triangle at its `place`."""
        if not self._count:  # LAPACK complains of empty matrices on stdout
            return self._corner
        product, _ = lapack.dlauum(self._corner.T, lower=1)
        square = np.asarray(product.T)
        # In the part K_BB comes last, column by column, in reversed order.
        begin = len(self._entries) - self._count * (self._count + 1) // 2
        for last in range(self._count - 1, -1, -1):
            square[last::-1, last] -= self._entries[begin : begin + last + 1]
            begin += last + 1
        return square

    def condense(self, rhs: Floats) -> Floats:
        """Eliminate the inner unknowns; return the forces that this leaves on the interface."""
        self._x = np.zeros(len(self._inner) + self._count)
        self._x[: len(self._inner)] = rhs[self._inner]
        self.factor.forward(self._x)
        return np.asarray(self._corner @ self._x[: -self._count - 1 : -1])

    def expand(self, at_interface: Floats, out: Floats) -> None:
        """Write the inner unknowns that follow from those of the interface."""
        x = self._x
        x[: -self._count - 1 : -1] = self._corner.T @ at_interface[self.place]
        self.factor.backward(x)
        out[self._inner] = x[: len(self._inner)]


def _lower(
    rows: LocalInts, columns: LocalInts, size: int
) -> tuple[LocalInts, LocalInts, LocalInts]:
    """Return pointers and rows of the first columns of a lower triangle, and their entries.

    Rows and columns are places of its entries or of their mirror images, each once.
    """
    first, second = np.minimum(rows, columns), np.maximum(rows, columns)
    shape = (size, int(second.max(initial=-1)) + 1)
    places = np.arange(len(rows), dtype=np.int32)
    matrix = csr_matrix((places, (first, second)), shape=shape)
    matrix.sort_indices()
    return matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), matrix.data


def _split(cholmod: Cholmod, indptr: LocalInts, columns: LocalInts, threads: int) -> Ints:
    """Return the part of each unknown, for as many parts as threads, rounded to a power of 2."""
    part: Ints = np.zeros(len(indptr) - 1, dtype=np.int64)
    whole = csr_matrix((np.ones(len(columns), dtype=np.int8), columns, indptr))
    for count in 2 ** np.arange(int(np.log2(threads))):
        for p in range(count):
            members = np.flatnonzero(part == p)
            if len(members) < 2 * LEAST_PART:
                continue
            block = whole[members][:, members]
            block.sort_indices()
            half = cholmod.bisect(block.indptr, block.indices)
            part[members[half > 0]] += count
    return np.unique(part, return_inverse=True)[1]


def _cover(pairs: Ints, part: Ints) -> Ints:
    """Return a smallest set of unknowns that meets every pair, for each two parts in turn.

    It is smallest by Kőnig's theorem: from a maximum matching, the unknowns of the first part that
    alternating paths from its unmatched ones do not reach, and those of the second that they do.
    """
    covered: Bools = np.zeros(len(part), dtype=bool)
    swap = part[pairs[:, 0]] > part[pairs[:, 1]]
    first, second = np.where(swap[:, None], pairs[:, ::-1], pairs).T
    parts = int(part.max(initial=0)) + 1
    which = part[first] * parts + part[second]
    for one in np.unique(which):
        chosen = (which == one) & ~covered[first] & ~covered[second]
        a, rows = np.unique(first[chosen], return_inverse=True)
        b, columns = np.unique(second[chosen], return_inverse=True)
        graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(a), len(b)))
        match = maximum_bipartite_matching(graph, perm_type="column")
        matched = np.flatnonzero(match >= 0)
        reached, right = match < 0, np.zeros(len(b), dtype=bool)
        count = -1
        while count < reached.sum():
            count = int(reached.sum())
            right = graph.T @ reached > 0
            reached[matched[right[match[matched]]]] = True
        covered[a[~reached]] = True
        covered[b[right]] = True
    return np.flatnonzero(covered)
