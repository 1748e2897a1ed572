"""Seams on surfaces: at creases, across regions, and such that each chart is a topological disc."""

from __future__ import annotations

import numpy as np
from scipy.cluster.hierarchy import DisjointSet
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    dijkstra,
    maximum_flow,
    minimum_spanning_tree,
)

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.triangles import (
    Edges,
    angle_defects,
    connected_regions,
    corner_angles,
    dihedral_angles,
    edges_of,
    fans,
    half_edges,
    lengths,
    linked,
    surface_areas,
)

# A vertex whose angles miss 2π by more than this, in rad, is a tip and not part of a smooth
# rounding. Seams go through the tips if these hold most of a chart's curvature.
CONE = 0.5
# A region smaller than this fraction of the surface is merged with a neighbour.
SMALLEST = 0.01
# A dividing seam lies between these fractions of the way from one far end to the other.
BAND = (0.42, 0.58)


def cut_open(triangles: Ints, edges: Edges, seams: Bools) -> tuple[Ints, Ints]:
    """Cut oriented triangles along seams, (e,); a single edge that separates nothing stays whole.

    Returned are the triangles of the cut surface, (t, 3), and the original vertex of each of its
    own, (m,).
    """
    open_edges = seams.copy()
    while True:
        fan = fans(triangles, edges, edges.inner[~open_edges[edges.inner]])
        slits = edges.inner[open_edges[edges.inner]]
        ends = half_edges(fan)[edges.twins[slits]]
        whole = (ends[:, 0] == ends[:, 1, ::-1]).all(axis=1)
        if not whole.any():
            break
        open_edges[slits[whole]] = False
    sewn = np.zeros(fan.max() + 1, dtype=np.int64)
    sewn[fan.ravel()] = triangles.ravel()
    return fan, sewn


def euler(triangles: Ints) -> int:
    """Return the Euler characteristic, vertices − edges + triangles: 1 for a disc."""
    return len(np.unique(triangles)) - len(edges_of(triangles).ends) + len(triangles)


def disc_cuts(points: Floats, triangles: Ints, *, tips: bool) -> Ints:
    """Return edges along which a connected region must be cut to become a disc.

    Borders and, on request, tips (vertices of high curvature) are connected by a tree of shortest
    paths, the approximation of a Steiner tree by Mehlhorn (1988,
    doi:10.1016/0020-0190(88)90066-X). Sheffer and Hart (2002, Seamster) cut through such tips. A
    region without borders and tips is slit between two vertices far apart. The remaining handles
    are cut along the shortest loops of a tree-cotree decomposition (Erickson and Whittlesey 2005,
    greedy homotopy generators). Edges have the numbers of `edges_of(triangles)`.
    """
    used, local = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], local.reshape(-1, 3)
    edges, chi = edges_of(triangles), euler(triangles)
    seams = np.zeros(len(edges.ends), dtype=bool)
    # Number of the border that each vertex is on, or of the tip that it is; −1 for others.
    groups = np.full(len(points), -1, dtype=np.int64)
    ends = edges.ends[edges.border]
    rim, border = np.unique(ends, return_inverse=True)
    if len(rim):
        one, two = border.reshape(-1, 2).T
        groups[rim] = linked(one, two, len(rim))
    if tips:
        found = cones(points, triangles, edges)
        groups[found] = groups.max() + 1 + np.arange(len(found))
    if groups.max() < 0 and chi == 2:
        groups[_far_apart(points, edges)] = 0, 1
    if groups.max() > 0:
        seams[_tree(points, edges, groups)] = True
        chi = euler(cut_open(triangles, edges, seams)[0])
    if chi != 1:
        seams[_loops(points, edges, seams)] = True
    return np.flatnonzero(seams)


def cones(points: Floats, triangles: Ints, edges: Edges) -> Ints:
    """Return the inner vertices that are tips, (k,); none if they do not hold most curvature."""
    defect = np.abs(angle_defects(triangles, edges, corner_angles(points, triangles)))
    tips = np.flatnonzero(defect > CONE)
    return tips if defect[tips].sum() > defect.sum() / 2 else tips[:0]


def _graph(points: Floats, edges: Edges) -> csr_array:
    return csr_array((lengths(points, edges.ends), edges.ends.T), shape=(len(points),) * 2)


def _far_apart(points: Floats, edges: Edges) -> Ints:
    graph = _graph(points, edges)
    one = int(np.argmax(dijkstra(graph, directed=False, indices=0)))
    return np.array([one, int(np.argmax(dijkstra(graph, directed=False, indices=one)))])


def _ways(points: Floats, edges: Edges, roots: Ints) -> tuple[Floats, Ints, Ints]:
    """Return the length of the way over each edge, (e,), and what shortest ways lead back.

    The way over an edge joins its ends with their nearest roots. Returned are further the vertex
    before each one on its way from a root, and this root, (n,).
    """
    distance, before, source = dijkstra(
        _graph(points, edges), directed=False, indices=roots, return_predecessors=True,
        min_only=True,
    )  # fmt: skip
    return distance[edges.ends].sum(axis=1) + lengths(points, edges.ends), before, source


def _tree(points: Floats, edges: Edges, groups: Ints) -> Ints:
    """Return the edges of a tree of shortest paths between groups of vertices (−1: no group)."""
    way, before, source = _ways(points, edges, np.flatnonzero(groups >= 0))
    pair = np.sort(groups[source][edges.ends], axis=1)
    bridges = np.flatnonzero(pair[:, 0] != pair[:, 1])
    bridges = bridges[np.argsort(way[bridges], kind="stable")]
    bridges = bridges[np.unique(pair[bridges], axis=0, return_index=True)[1]]
    count = int(groups.max()) + 1
    ends = pair[bridges].T.astype(np.int32)  # minimum_spanning_tree takes no wider indices
    graph = csr_array((way[bridges], ends), shape=(count, count))
    chosen = np.stack(minimum_spanning_tree(graph).nonzero(), axis=1)
    bridges = bridges[np.isin(pair[bridges] @ [count, 1], chosen @ [count, 1])]
    return np.concatenate([bridges, _ways_back(edges, before, edges.ends[bridges].ravel())])


def _ways_back(edges: Edges, before: Ints, starts: Ints) -> Ints:
    """Return the edges on the paths from vertices back to the source of a shortest-path search."""
    number = {(int(a), int(b)): k for k, (a, b) in enumerate(edges.ends)}
    found: set[int] = set()
    for start in starts:
        here = int(start)
        while (back := int(before[here])) >= 0:
            edge = number[min(here, back), max(here, back)]
            if edge in found:
                break
            found.add(edge)
            here = back
    return np.array(sorted(found), dtype=np.int64)


def _loops(points: Floats, edges: Edges, seams: Bools) -> Ints:
    """Return the edges of shortest loops, or arcs between seams and borders, that open handles."""
    on = np.unique(np.concatenate([edges.ends[edges.border], edges.ends[seams]]))
    roots = on if len(on) else _far_apart(points, edges)[:1]
    way, before, _ = _ways(points, edges, roots)
    crossed = edges.count == 2
    crossed[_ways_back(edges, before, np.arange(len(points)))] = False
    free = np.flatnonzero(crossed & ~seams)
    # The dual tree crosses the edges with the longest loops, so that short loops remain.
    free = free[np.argsort(-way[free], kind="stable")]
    joined = DisjointSet(range(len(edges.of_triangle)))
    remain = [edge for edge in free if not joined.merge(*edges.sides[edge].tolist())]
    rest = np.array(remain, dtype=np.int64)
    return np.concatenate([rest, _ways_back(edges, before, edges.ends[rest].ravel())])


# ------------------------------------------------------------------------------------- regions


def crease_regions(points: Floats, triangles: Ints, angle: float) -> Ints:
    """Return the region of each triangle, (t,): between creases, small ones merged with neighbours.

    The normals of neighbours differ by more than the angle, in rad, where their edge is a crease.
    """
    edges = edges_of(triangles)
    inner = edges.inner
    sharp = dihedral_angles(points, triangles, edges) > angle
    region = connected_regions(edges, inner[~sharp[inner]])
    area, length = surface_areas(points, triangles), lengths(points, edges.ends)
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
    fraction = from_near / (from_near + dijkstra(dual, directed=False, indices=far))
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
