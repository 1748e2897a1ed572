"""Surfaces meshed anew, with edges along their seams; seams at creases, and into discs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.cluster.hierarchy import DisjointSet
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, dijkstra, maximum_flow, minimum_spanning_tree

from toros_fem.base.errors import SurfaceError, TorosError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import Bools, Floats, Ints, require_kind, require_positive
from toros_fem.meshes.panels import gmsh_model, meshed
from toros_fem.meshes.surface import Nearest, Surface, nearest, oriented
from toros_fem.meshes.triangles import (
    Edges,
    angle_defects,
    between,
    connected_regions,
    corner_angles,
    dihedral_angles,
    edges_of,
    fans,
    half_edges,
    lengths,
    linked,
    normals,
    require_affordable,
    surface_areas,
)

# Largest distance between the two surfaces over the edge length: triangles across a ridge that is
# just no crease are 0.2 to 0.3 away from it.
FAR = 0.35
# Angle in rad that is missing around a vertex, from which on the surface has a tip there.
TIP = 0.25
# Distance from a kept curve, over the edge length, within which a tip is of the curve.
ALONG = 0.25
# Largest angle in rad between triangles side by side, unless the surface has a larger one: beyond
# it some face inwards.
FOLDED = np.radians(120)
# How much sharper than the surface's own such a fold may be, in rad.
SHARPER = np.radians(10)
# Part of the size within which a place is on a line.
EXACT = 1e-6
# Lengths of edges are those asked for, whatever the given vertices or a curvature would ask for.
OPTIONS = {
    "Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeFromCurvature": 0,
}  # fmt: skip
# A vertex whose angles miss 2π by more than this, in rad, is a tip and not part of a smooth
# rounding. Seams go through the tips if these hold most of a chart's curvature.
CONE = 0.5
# A region smaller than this fraction of the surface is merged with a neighbour.
SMALLEST = 0.01
# A dividing seam lies between these fractions of the way from one far end to the other.
BAND = (0.42, 0.58)


@dataclass(frozen=True, eq=False)
class Remeshed:
    """A surface that was meshed anew.

    Attributes:
        surface: The surface; its `repairs` tell what was done.
        weights: Matrix, (m, n), that interpolates values at the given vertices to the new ones.
        distance: Largest distance in m found between the two surfaces, at the given vertices, and
            at the middles of new edges and triangles.
    """

    surface: Surface
    weights: csr_array
    distance: float


@on_root
def remeshed(
    comm: MPI.Comm,
    surface: Surface,
    edge_length: float,
    *,
    crease_angle: float = np.radians(45),
) -> Remeshed:
    """Mesh a surface anew, with edges of a length in m, by gmsh (collective).

    Vertices lie on the given triangles. Borders, seams, borders between parts and creases become
    edges of the new mesh.

    Args:
        surface: The surface, the same on all ranks.
        edge_length: Edge length in m.
        crease_angle: Angle between normals above which an edge is a crease, in rad.

    Raises:
        ParameterError: An argument is out of its bounds, or the mesh has too many triangles.
        SurfaceError: gmsh fails, or the mesh is another surface: further away than a third of an
            edge, or folded back onto itself, for instance.
    """
    require_kind("surface", surface, Surface, "a Surface, by read_surface")
    require_positive(edge_length=edge_length)
    require_positive(**{"crease_angle, in rad,": crease_angle}, at_most=np.pi)
    require_affordable(surface.area, edge_length)
    places, triangles, on_curves = _by_gmsh(surface, edge_length, crease_angle)
    at = nearest(places, surface.points, surface.triangles)
    _keep_tips(surface, at, places, on_curves, edge_length)
    weights = at.weights(surface.triangles, len(surface.points))
    points = weights @ surface.points  # exactly in a plane that borders lie in
    middle = nearest(points[triangles].mean(axis=1), surface.points, surface.triangles)
    triangles, parts = _oriented(surface, points, triangles, middle), surface.parts[middle.triangle]
    ends = edges_of(triangles).ends
    distance = _largest_distance(surface, points, triangles, ends, middle)
    if distance > FAR * edge_length:
        raise _refusal(
            surface, edge_length, f"it would be up to {distance:.3g} m away from the surface; "
            f"the bound is {FAR:g} of an edge",
        )  # fmt: skip
    told = (
        f"{len(surface.triangles)} triangles meshed anew by {len(triangles)}, "
        f"{1e3 * distance:.2g} mm apart at most"
    )
    try:
        made = Surface(
            points, triangles, parts, surface.part_names,
            _seams(surface, points, on_curves, FAR * edge_length),
            told if surface.repairs == "none" else f"{surface.repairs}, {told}",
        )  # fmt: skip
    except TorosError as error:
        why = f"it would be no surface: {str(error).removesuffix('.')}"
        raise _refusal(surface, edge_length, why) from error
    other = made.closed != surface.closed or euler(triangles) != euler(surface.triangles)
    before = dihedral_angles(surface.points, surface.triangles, edges_of(surface.triangles)).max()
    after = dihedral_angles(points, triangles, edges_of(triangles)).max()
    bound = max(FOLDED, before + SHARPER)
    if other or after > bound:
        folded = f"{np.degrees(after):.0f} degrees; the bound is {np.degrees(bound):.0f}"
        why = "have other holes or handles" if other else f"be folded by {folded}"
        raise _refusal(surface, edge_length, f"it would {why}")
    return Remeshed(made, weights, distance)


def _refusal(surface: Surface, edge_length: float, why: str) -> SurfaceError:
    return SurfaceError(
        f"the surface of {len(surface.triangles)} triangles cannot be meshed anew with edges of "
        f"{edge_length:.3g} m: {why}. Take shorter edges or a smaller crease_angle, "
        "or remesh the file in another program."
    )


def _by_gmsh(
    surface: Surface, edge_length: float, crease_angle: float
) -> tuple[Floats, Ints, Ints]:
    """Return new points, (m, 3), triangles, and the edges on curves that were kept, (k, 2)."""
    edges = edges_of(surface.triangles)
    named = np.concatenate([surface.seams, edges.ends[between(edges, surface.parts)]])
    with gmsh_model(edge_length, OPTIONS) as gmsh:
        mesh = gmsh.model.mesh
        gmsh.model.addDiscreteEntity(2, 1)
        mesh.addNodes(2, 1, np.arange(1, 1 + len(surface.points)), surface.points.ravel())
        mesh.addElementsByType(1, 2, [], (1 + surface.triangles).ravel())
        if len(named):
            gmsh.model.addDiscreteEntity(1, 1)
            mesh.addElementsByType(1, 1, [], (1 + named).ravel())
        try:
            mesh.classifySurfaces(crease_angle, True, True, crease_angle)
            mesh.createGeometry()
            return meshed(gmsh)
        except Exception as error:  # gmsh raises no other type
            raise _refusal(surface, edge_length, f"gmsh fails ({error})") from error


def _keep_tips(
    surface: Surface, at: Nearest, places: Floats, on_curves: Ints, edge_length: float
) -> None:
    """Move the nearest new vertex into each tip of the surface, unless a curve goes along there."""
    points, edges = surface.points, edges_of(surface.triangles)
    angles = corner_angles(points, surface.triangles)
    defects = np.abs(angle_defects(surface.triangles, edges, angles))
    tips = np.argsort(-defects, kind="stable")[: np.count_nonzero(defects > TIP)]
    free = np.ones(len(places), dtype=bool)
    free[on_curves] = False
    first = surface.triangles.ravel().tolist().index
    for tip in tips[_from_lines(points[tips], places[on_curves]) > ALONG * edge_length]:
        away = np.where(free, np.linalg.norm(places - points[tip], axis=1), np.inf)
        mover = int(away.argmin())
        if away[mover] < edge_length:
            at.triangle[mover], corner = divmod(first(tip), 3)
            at.shares[mover], free[mover] = np.eye(3)[corner], False


def _oriented(surface: Surface, points: Floats, triangles: Ints, middle: Nearest) -> Ints:
    """Return triangles oriented as the given ones are."""
    try:
        agreed = oriented(triangles)
    except TorosError:
        return triangles  # refused as a surface
    given = normals(surface.points, surface.triangles)[middle.triangle]
    alike = np.einsum("ti,ti->t", normals(points, agreed), given)
    return agreed if alike.sum() > 0 else agreed[:, ::-1]


def _largest_distance(
    surface: Surface, points: Floats, triangles: Ints, ends: Ints, middle: Nearest
) -> float:
    used = surface.points[np.unique(surface.triangles)]
    there = nearest(used, points, triangles)
    sides = nearest(points[ends].mean(axis=1), surface.points, surface.triangles)
    return max(float(one.distance.max()) for one in (there, sides, middle))


def _seams(surface: Surface, points: Floats, on_curves: Ints, near: float) -> Ints:
    """Return the edges, of those on curves, that follow the surface's own seams, (k, 2)."""
    seams, both = surface.points[surface.seams], points[on_curves]
    ends = np.maximum(_from_lines(both[:, 0], seams), _from_lines(both[:, 1], seams))
    middle = _from_lines(both.mean(axis=1), seams)
    return on_curves[(ends < EXACT * surface.size) & (middle < near)]


def _from_lines(places: Floats, lines: Floats) -> Floats:
    """Return the distance of places (p, 3) from the nearest of straight lines (k, 2, 3), (p,)."""
    if not len(lines):
        return np.full(len(places), np.inf)
    begin, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    way = np.einsum("pki,ki->pk", places[:, None] - begin, along) / (along**2).sum(axis=1)
    feet = begin + np.clip(way, 0, 1)[..., None] * along
    return np.asarray(np.linalg.norm(places[:, None] - feet, axis=2).min(axis=1))


# ------------------------------------------------------------------------------------------ seams


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
