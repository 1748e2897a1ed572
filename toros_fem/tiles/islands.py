"""Which printed pieces of a tile hang on nothing: those that do not reach their own copies."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from toros_fem._types import Floats
from toros_fem.meshes.tile import Tile
from toros_fem.meshes.topology import edges_of, following


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
    edges = edges_of(pattern.triangles)
    # Each triangle sees an edge's first end with wraps of its own; both differ by the step
    # from one triangle's frame to the other's.
    starts = pattern.triangles.ravel()[edges.twins]
    corner = np.where(starts == edges.ends[:, :1], edges.twins, following(edges.twins))
    seen = tile.wraps.reshape(-1, 2)[corner]
    (one, two), step = edges.sides.T, seen[:, 0] - seen[:, 1]
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
