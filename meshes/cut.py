"""Cutting a surface open along seams into charts, each a topological disc."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.triangles import (
    Edges,
    angle_defects,
    connected_regions,
    corner_angles,
    edges_of,
    fans,
    half_edges,
    lengths,
)

# A vertex whose angles miss 2π by more than this, in rad, is a tip and not part of a smooth
# rounding. Seams go through the tips if these hold most of a chart's curvature.
CONE = 0.5


@dataclass(frozen=True, eq=False)
class Cut:
    """A surface cut open along seams.

    Attributes:
        chart: Chart of each triangle, shape (t,), from 0.
        triangles: Corners of each triangle among the vertices of the cut surface, (t, 3).
        sewn: Vertex of the original surface for each vertex of the cut one, shape (m,).
    """

    chart: Ints
    triangles: Ints
    sewn: Ints


def cut_open(triangles: Ints, edges: Edges, seams: Bools) -> Cut:
    """Cut along seams.

    Args:
        triangles: Oriented manifold triangles (t, 3).
        edges: Their edges.
        seams: Whether to cut each edge, (e,). A single edge that separates nothing stays whole.
    """
    open_edges = seams.copy()
    while True:
        crossed = edges.inner[~open_edges[edges.inner]]
        fan = fans(triangles, edges, crossed)
        slits = edges.inner[open_edges[edges.inner]]
        ends = half_edges(fan)[edges.twins[slits]]
        whole = (ends[:, 0] == ends[:, 1, ::-1]).all(axis=1)
        if not whole.any():
            break
        open_edges[slits[whole]] = False
    sewn = np.zeros(fan.max() + 1, dtype=np.int64)
    sewn[fan.ravel()] = triangles.ravel()
    return Cut(connected_regions(edges, crossed), fan, sewn)


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
    greedy homotopy generators).

    Args:
        points: Vertices (n, 3) in m.
        triangles: Oriented triangles of one connected region (t, 3).
        tips: Whether to cut through tips too.

    Returns:
        Indices of edges, as `edges_of(triangles)` numbers them.
    """
    used, local = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], local.reshape(-1, 3)
    edges = edges_of(triangles)
    seams = np.zeros(len(edges.ends), dtype=bool)
    chi = euler(triangles)
    groups = _borders(edges, len(points))
    if tips:
        found = cones(points, triangles, edges)
        groups[found] = groups.max() + 1 + np.arange(len(found))
    if groups.max() < 0 and chi == 2:
        groups[_far_apart(points, edges)] = 0, 1
    if groups.max() > 0:
        seams[_tree(points, edges, groups)] = True
        cut = cut_open(triangles, edges, seams)
        chi = euler(cut.triangles)
    if chi != 1:
        seams[_loops(points, triangles, edges, seams)] = True
    return np.flatnonzero(seams)


def _graph(points: Floats, edges: Edges) -> csr_array:
    a, b = edges.ends.T
    return csr_array((lengths(points, edges.ends), (a, b)), shape=(len(points),) * 2)


def _borders(edges: Edges, size: int) -> Ints:
    """Return the number of the border that each vertex is on, −1 inside."""
    a, b = edges.ends[edges.border].T
    graph = csr_array((np.ones(len(a)), (a, b)), shape=(size, size))
    label = connected_components(graph, directed=False)[1].astype(np.int64)
    inside = np.ones(size, dtype=bool)
    inside[np.concatenate([a, b])] = False
    label[inside] = -1
    return np.unique(np.append(label, -1), return_inverse=True)[1].ravel()[:-1] - 1


def cones(points: Floats, triangles: Ints, edges: Edges) -> Ints:
    """Return the inner vertices that are tips, (k,); none if they do not hold most curvature."""
    defect = np.abs(angle_defects(triangles, edges, corner_angles(points, triangles)))
    tips = np.flatnonzero(defect > CONE)
    return tips if defect[tips].sum() > defect.sum() / 2 else tips[:0]


def _far_apart(points: Floats, edges: Edges) -> Ints:
    graph = _graph(points, edges)
    one = int(np.argmax(dijkstra(graph, directed=False, indices=0)))
    return np.array([one, int(np.argmax(dijkstra(graph, directed=False, indices=one)))])


def _tree(points: Floats, edges: Edges, groups: Ints) -> Ints:
    """Return the edges of a tree of shortest paths between groups of vertices (−1: no group)."""
    distance, before, source = dijkstra(
        _graph(points, edges), directed=False, indices=np.flatnonzero(groups >= 0),
        return_predecessors=True, min_only=True,
    )  # fmt: skip
    nearest = groups[source]
    pair = np.sort(nearest[edges.ends], axis=1)
    way = distance[edges.ends].sum(axis=1) + lengths(points, edges.ends)
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


def _loops(points: Floats, triangles: Ints, edges: Edges, seams: Bools) -> Ints:
    """Return the edges of shortest loops, or arcs between seams and borders, that open handles."""
    on = np.unique(np.concatenate([edges.ends[edges.border], edges.ends[seams]]))
    roots = on if len(on) else np.array([_far_apart(points, edges)[0]])
    distance, before, _ = dijkstra(
        _graph(points, edges), directed=False, indices=roots, return_predecessors=True,
        min_only=True,
    )  # fmt: skip
    in_tree = np.zeros(len(edges.ends), dtype=bool)
    in_tree[_ways_back(edges, before, np.arange(len(points)))] = True
    free = edges.inner[~in_tree[edges.inner] & ~seams[edges.inner]]
    way = distance[edges.ends[free]].sum(axis=1) + lengths(points, edges.ends[free])
    # The dual tree crosses the edges with the longest loops, so that short loops remain.
    leader = np.arange(len(triangles))

    def find(t: int) -> int:
        while leader[t] != t:
            leader[t] = leader[leader[t]]
            t = int(leader[t])
        return t

    remain = []
    for edge in free[np.argsort(-way, kind="stable")]:
        one, two = (find(int(t)) for t in edges.sides[edge])
        if one == two:
            remain.append(edge)
        leader[one] = two
    rest = np.array(remain, dtype=np.int64)
    return np.concatenate([rest, _ways_back(edges, before, edges.ends[rest].ravel())])
