"""Islands of a tile's print: printed components that do not reach their own periodic images."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from toros_fem._types import Bools, Floats
from toros_fem.meshes.tile import Tile
from toros_fem.meshes.topology import edges_of, following


def island_areas(tile: Tile, printed: Bools) -> Floats:
    """Return the areas in m² of the printed islands, the largest first.

    Printed triangles belong to one component if they share edges. A component that reaches its own
    image in a neighbouring tile is a line or a net through the whole sheet; any other is an island.

    Args:
        tile: The tile.
        printed: Whether each triangle is printed, (t,).
    """
    pattern = tile.pattern
    count = len(pattern.triangles)
    edges = edges_of(pattern.triangles)
    # Each triangle sees an edge's first end with wraps of its own; their difference is the step
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
    steps = {}
    for k in range(len(one)):
        a, b = int(one[k]), int(two[k])
        steps[a, b], steps[b, a] = step[k], -step[k]
    first = np.unique(label, return_index=True)[1]
    connected = np.zeros(number, dtype=bool)
    for component in range(number):
        if not printed[first[component]]:
            continue
        cells, parent = breadth_first_order(graph, int(first[component]), directed=False)
        for cell in cells[1:].tolist():
            offset[cell] = offset[parent[cell]] + steps[int(parent[cell]), cell]
    # Two ways to one triangle that differ by a lattice vector join the component to its image.
    np.logical_or.at(connected, label[one], np.any(offset[two] - offset[one] != step, axis=1))
    areas = np.bincount(label, pattern.areas, minlength=number)
    return np.asarray(np.sort(areas[printed[first] & ~connected])[::-1])
