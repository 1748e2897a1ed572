"""Automatic seams: at the creases of a surface, and short ones that divide a region in two."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, dijkstra, maximum_flow

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.triangles import (
    connected_regions,
    dihedral_angles,
    edges_of,
    lengths,
    normals,
)

# A region smaller than this fraction of the surface is merged with a neighbour.
SMALLEST = 0.01
# A dividing seam lies between these fractions of the way from one far end to the other.
BAND = (0.42, 0.58)


def crease_regions(points: Floats, triangles: Ints, angle: float) -> Ints:
    """Return the region of each triangle, (t,): between creases, small ones merged with neighbours.

    Args:
        points: Vertices (n, 3) in m.
        triangles: Oriented manifold triangles (t, 3).
        angle: Angle between neighbours' normals, in rad, above which their edge is a crease.
    """
    edges = edges_of(triangles)
    inner = edges.inner
    sharp = dihedral_angles(points, triangles, edges) > angle
    region = connected_regions(edges, inner[~sharp[inner]])
    area = np.linalg.norm(normals(points, triangles), axis=1)
    length = lengths(points, edges.ends)
    while region.max() > 0:
        fraction = np.bincount(region, area) / area.sum()
        small = int(np.argmin(fraction))
        if fraction[small] >= SMALLEST:
            break
        pair = region[edges.sides[inner]]
        touching = (pair == small).sum(axis=1) == 1
        other = pair[touching].sum(axis=1) - small
        into = int(np.argmax(np.bincount(other, length[inner[touching]])))
        region[region == small] = into
        region = np.unique(region, return_inverse=True)[1].ravel()
    return region


def halves(points: Floats, triangles: Ints) -> Ints:
    """Divide a connected region in two by a short seam across it; return 0 or 1 for each triangle.

    Two triangles far apart are the ends of the region. The seam is the shortest one near the middle
    between them: a minimum cut of the dual graph.

    Args:
        points: Vertices (n, 3) in m.
        triangles: At least two triangles (t, 3).
    """
    edges = edges_of(triangles)
    inner, size = edges.inner, len(triangles)
    one, two = edges.sides[inner].T
    centre = points[triangles].mean(axis=1)
    apart = np.linalg.norm(centre[one] - centre[two], axis=1)
    # Equal entries are added up: two triangles that share two edges, which is rare, count as
    # twice as far apart. This moves the middle a little.
    dual = coo_array((apart, (one, two)), shape=(size, size)).tocsr()
    near = int(np.argmax(dijkstra(dual, directed=False, indices=0)))
    from_near = dijkstra(dual, directed=False, indices=near)
    far = int(np.argmax(from_near))
    from_far = dijkstra(dual, directed=False, indices=far)
    fraction = from_near / (from_near + from_far)
    fraction[[near, far]] = 0, 1
    length = lengths(points, edges.ends[inner])
    weight = np.maximum(1, np.round(1e5 * length / length.max())).astype(np.int32)
    total = np.int32(min(weight.sum(dtype=np.int64), 2**30))
    start, end = np.flatnonzero(fraction <= BAND[0]), np.flatnonzero(fraction >= BAND[1])
    rows = np.concatenate([one, two, np.full(len(start), size), end]).astype(np.int32)
    cols = np.concatenate([two, one, start, np.full(len(end), size + 1)]).astype(np.int32)
    capacity = np.concatenate([weight, weight, np.full(len(start) + len(end), total)])
    network = csr_array((capacity, (rows, cols)), shape=(size + 2, size + 2), dtype=np.int32)
    rest = network - maximum_flow(network, size, size + 1).flow
    rest.data[rest.data < 0] = 0
    rest.eliminate_zeros()
    reached = breadth_first_order(csr_array(rest), size, return_predecessors=False)
    second = np.ones(size, dtype=np.int64)
    second[reached[reached < size]] = 0
    return second
