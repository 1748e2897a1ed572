"""Which printed pieces of a tile hang on nothing: those that do not reach their own copies."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from toros_fem.meshes.tile import Tile

Floats = npt.NDArray[np.float64]


def loose_pieces(tile: Tile, printed: npt.NDArray[np.bool_]) -> Floats:
    """Areas in m² of the printed pieces that lie apart from all their copies, the largest first.

    A piece that reaches its own copy in the next tile is a line or a net through the whole sheet;
    any other is an island. Pieces are joined by edges.

    Args:
        tile: The tile.
        printed: Which triangles are printed, (t,).
    """
    pattern = tile.pattern
    count = len(pattern.triangles)
    # Half-edges in the order of the triangles, each with where its first end lies.
    ends = np.stack([pattern.triangles, np.roll(pattern.triangles, -1, axis=1)], axis=2)
    keys = np.sort(ends, axis=2).reshape(-1, 2)
    _, edge = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(edge.ravel(), kind="stable").reshape(-1, 2)
    low = np.argmin(ends.reshape(-1, 2), axis=1)
    wraps = np.stack([tile.wraps, np.roll(tile.wraps, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    seen = wraps[np.arange(len(low)), low]
    one, two = order[:, 0] // 3, order[:, 1] // 3
    step = seen[order[:, 0]] - seen[order[:, 1]]  # from one triangle's frame to the other's
    both = printed[one] & printed[two]
    one, two, step = one[both], two[both], step[both]
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(count, count)).tocsr()
    number, label = connected_components(graph, directed=False)
    offset = np.zeros((count, 2), dtype=np.int64)
    known = {}
    for k in range(len(one)):
        a, b = int(one[k]), int(two[k])
        known[a, b], known[b, a] = step[k], -step[k]
    first = np.unique(label, return_index=True)[1]
    through = np.zeros(number, dtype=bool)
    for piece in range(number):
        if not printed[first[piece]]:
            continue
        cells, before = breadth_first_order(graph, int(first[piece]), directed=False)
        for cell in cells[1:].tolist():
            offset[cell] = offset[before[cell]] + known[int(before[cell]), cell]
    np.logical_or.at(through, label[one], np.any(offset[two] - offset[one] != step, axis=1))
    size = np.bincount(label, pattern.areas, minlength=number)
    return np.asarray(np.sort(size[printed[first] & ~through])[::-1])
