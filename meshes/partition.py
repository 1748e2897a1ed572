"""Which rank owns which triangle: cuts across the longest axis, the same in every run."""

from __future__ import annotations

from typing import Any

import numpy as np

from toros_fem.base import compat
from toros_fem.base.array_types import Ints
from toros_fem.meshes.pattern import Pattern


def parts_of(pattern: Pattern, count: int) -> Ints:
    """Return the part of each triangle, (t,): compact parts of nearly equal sizes.

    Recursive bisection by inertia: the assembled triangles are divided across the axis along which
    they extend most (Simon 1991). Graph partitioners give shorter borders on branched shapes, but
    on several ranks not the same ones in every run.

    Args:
        pattern: Any pattern.
        count: Number of parts, at least 1.
    """
    middles = pattern.points[pattern.triangles].mean(axis=1)
    found = np.zeros(len(middles), dtype=np.int64)
    everything: Ints = np.arange(len(middles), dtype=np.int64)
    left = [(everything, 0, count)]
    while left:
        cells, first, number = left.pop()
        if number == 1:
            found[cells] = first
            continue
        away = middles[cells] - middles[cells].mean(axis=0)
        axis = np.linalg.eigh(away.T @ away)[1][:, -1]
        ordered = cells[np.argsort(away @ axis, kind="stable")]
        half = number // 2
        size = round(len(cells) * half / number)
        left.append((ordered[:size], first, half))
        left.append((ordered[size:], first + half, number - half))
    return found


def partitioner(pattern: Pattern) -> Any:
    """Return a partitioner for `dolfinx.mesh.create_mesh` with a ghost layer across edges.

    The first rank must give all triangles, in the pattern's order, and the others none.

    Args:
        pattern: The pattern.
    """

    def destinations(_comm: Any, ranks: int, _types: Any, cells: Any) -> Any:
        if len(cells[0]) == 0:
            return compat.adjacency(np.zeros(0, np.int32), np.zeros(1, np.int32))
        part = parts_of(pattern, ranks)
        one, two = pattern.edges.twins[pattern.edges.inner].T // 3
        both = np.concatenate([np.stack([one, two], axis=1), np.stack([two, one], axis=1)])
        seen = np.unique(np.column_stack([both[:, 0], part[both[:, 1]]]), axis=0)
        seen = seen[part[seen[:, 0]] != seen[:, 1]]  # ghosts of other ranks
        own = np.column_stack([np.arange(len(part)), part])
        rows = np.concatenate([own, seen])
        rows = rows[np.argsort(rows[:, 0], kind="stable")]  # the owner comes first
        offsets = np.concatenate([[0], np.cumsum(np.bincount(rows[:, 0]))])
        return compat.adjacency(rows[:, 1].astype(np.int32), offsets.astype(np.int32))

    return destinations
