"""Entries of the tangent, found by pairs of vertices and edges instead of pairs of unknowns."""

from __future__ import annotations

from itertools import product

import numpy as np

from toros_fem.base.array_types import Bools, Ints, LocalInts
from toros_fem.mechanics.assembly.model import SkinModel

# Triangles treated at once: the work arrays stay in the processor's cache.
CHUNK = 2000


class BlockPairs:
    """Pairs of blocks that a triangle sees together, and the entries of the tangent in them.

    A block is the position of a vertex, three unknowns, or the rotation of an edge. A patch has 21
    unknowns and 231 pairs of them, but only 9 blocks and 45 pairs: these alone are sorted.

    Attributes:
        keys: Entry row · size + column of the tangent's upper triangle, in global unknowns, without
            fixed ones; sorted and distinct.
        twice: Numbers of `SkinModel.tangent_entries` at which (i, j) and (j, i) coincide, because
            a patch meets one vertex twice.
        count: Numbers that belong to triangles.

    Args:
        model: The skin's model.
    """

    def __init__(self, model: SkinModel) -> None:
        index_map = model.space.dofmap.index_map
        local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        number = index_map.local_to_global(local)
        self._row, dofs, present = model.tangent_layout
        unknowns = dofs.shape[1]
        nodes = min(unknowns, 18) // 3
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
        self.count = len(dofs) * len(i)
        met, pair_met = np.nonzero((one == two) & seen_both & (u != v))
        again = (self._pair_of == pair_met[:, None]) & (inside[i] == inside[j])
        meeting, entry = np.nonzero(again)
        self.twice: Ints = self._row[met[meeting]].astype(np.int64) * len(i) + entry

    def places(self, of_key: Ints) -> LocalInts:
        """Return the place of each number of the triangles, (count,).

        Args:
            of_key: Place of each of the keys, and of numbers without a key: one more.
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

    Args:
        used: Whether each slot of each pair has an entry.
        low: First block of each pair, (p,), ascending.
        blocks: Number of blocks.
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
