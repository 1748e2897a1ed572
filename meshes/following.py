"""Meshes that follow the borders of polygons: vertices are moved onto them, and move with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from mpi4py import MPI
from scipy.sparse import csr_array
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import PatternError
from toros_fem.base.mpi import on_root
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.triangles import (
    barycentric,
    between,
    cross,
    edges_of,
    least_angles,
    lengths,
    normals,
)

# No triangle gets an angle below this, unless it had a smaller one, in rad.
LEAST_ANGLE = np.radians(18.0)
# Vertices of triangles with an angle below this are smoothed, in rad.
GOOD_ANGLE = np.radians(30.0)
# Longest way of a vertex, over the mean length of the edges around it.
REACH = 0.5
# A border this close to an end of an edge, over its length, does not cut it.
NEAR_END = 0.05
# Rounds of moves onto borders, with smoothing in between, and sweeps of each smoothing.
ROUNDS = 5
SWEEPS = 2
# Places closer than this fraction of the skin's size are the same; directions closer than this,
# in rad, are too.
SAME = 1e-7
# Triangles whose normals differ by more than this do not belong to the same smooth surface, in rad.
CREASE = np.radians(45.0)
# Number of triangles around among which the one below a moved vertex is looked for.
NEIGHBOURS = 24
# A corner of a border moves by at most this multiple of the border's own way.
LONGEST = 2.0
# A spike whose normals sum up to less than this stays.
SHARP = 1e-3
# The direction of the polygon's border is taken where it is as close as this, over the square root
# of the mean area, and turned from that of the mesh by no more than this cosine says.
NEAR, ALIKE = 1.5, np.cos(np.radians(60.0))
# Angles may shrink to this fraction of what they were; where they would, the way is halved, so
# many times at most.
KEPT_ANGLE, HALVINGS = 0.4, 6


@on_root
def snapped(comm: MPI.Comm, pattern: Pattern, regions: Regions) -> Pattern:
    """Return the same triangles with vertices moved onto the borders of regions (collective).

    Of each edge that a border cuts, the nearer end is moved onto it in the flat chart, if all
    triangles around keep angles of at least 18°. Vertices on a seam or a free border slide along
    it, both sides of a seam alike, and stay where it turns: outlines and seams are kept. In the
    assembled shape a vertex moves along the curved surface that the normals of its panel suggest.
    Edges should not be much longer than the regions are wide.
    """
    pattern.require_regions(regions)
    mesh = _MovingMesh(pattern, regions)
    for turn in range(ROUNDS if mesh.any_border else 0):
        if turn:
            mesh.smooth()
        mesh.snap()
    return with_flat_points(pattern, mesh.flat)


def with_flat_points(pattern: Pattern, flat: Floats) -> Pattern:
    """Return the same triangles with flat points, (m, 2), that have moved within their panels.

    Those of a vertex on a seam have moved alike. In the assembled shape a vertex moves along the
    curved surface that the normals of its panel suggest (Boubekeur and Alexa, "Phong tessellation",
    ACM TOG 27(5), 2008, with the factor 1/2, by which an arc comes out to third order). Vertices on
    borders stay on the edges between vertices.
    """
    edges = edges_of(pattern.flat_triangles)
    inner = np.ones(len(pattern.points), dtype=bool)
    inner[pattern.sewn[edges.ends[edges.border]]] = False
    points, panel = pattern.points.copy(), pattern.panel_of_point
    moved = np.flatnonzero(np.any(flat != pattern.flat_points, axis=1))
    cell, weight = located(pattern, panel[moved], flat[moved])
    vertex = pattern.sewn[moved]
    points[vertex] = places_on(pattern, cell, weight, curved=inner[vertex])
    return replace(pattern, flat_points=flat, points=points)


def located(pattern: Pattern, panel: Ints, places: Floats) -> tuple[Ints, Floats]:
    """Return the triangle at each place, (k, 2) in m on panels (k,), and barycentric coordinates.

    A place outside of its panel gets the nearest triangle.
    """
    cell: Ints = np.zeros(len(places), dtype=np.int64)
    for number in np.unique(panel):
        here, cells = np.flatnonzero(panel == number), np.flatnonzero(pattern.panel == number)
        tree = shapely.STRtree(shapely.polygons(pattern.corners[cells]))
        cell[here] = cells[tree.nearest(shapely.points(places[here]))]
    weight: Floats = barycentric(pattern.corners[cell], places[:, None])[:, 0]
    inner = np.maximum(weight, 0.0)
    return cell, inner / inner.sum(axis=1, keepdims=True)


def places_on(pattern: Pattern, cell: Ints, weight: Floats, *, curved: Bools) -> Floats:
    """Return assembled places, (k, 3), in triangles at barycentric coordinates, (k,) and (k, 3).

    Those that are `curved` lie on the curved surface that the normals of the panel suggest, as of
    `with_flat_points`, others in the flat triangle.
    """
    corner = pattern.flat_triangles[cell]
    corners, up = pattern.points[pattern.sewn[corner]], _normals(pattern)[corner]
    place = np.einsum("ij,ijk->ik", weight, corners)
    off = np.einsum("ijk,ijk->ij", place[:, None] - corners, up)
    bulge = 0.5 * np.einsum("ij,ij,ijk->ik", weight, off, up)
    return np.asarray(place - bulge * curved[:, None])


def straight_on(pattern: Pattern, border: Ints) -> tuple[Bools, Ints]:
    """Return whether outlines, flat edges (k, 2), go straight on at each vertex, (n,).

    All flat points of such a vertex lie between the same two vertices. Also returned are the
    neighbours of each flat point along the outline, (m, 2), in the same order on both sides of a
    seam; −1 for others.
    """
    sewn, flat, count = pattern.sewn, pattern.flat_points, len(pattern.points)
    both = np.concatenate([border, border[:, ::-1]])
    both = both[np.lexsort((sewn[both[:, 1]], both[:, 0]))]
    both = both[np.bincount(border.ravel(), minlength=len(flat))[both[:, 0]] == 2]
    point, around = both[::2, 0], both[:, 1].reshape(-1, 2)
    one, two = (flat[around[:, i]] - flat[point] for i in range(2))
    turn = np.abs(np.arctan2(cross(one, two), -np.einsum("ij,ij->i", one, two)))
    vertex, between_two = sewn[point], sewn[around]
    low, high = np.full((count, 2), count), np.full((count, 2), -1)
    np.minimum.at(low, vertex, between_two)
    np.maximum.at(high, vertex, between_two)
    straight = np.bincount(vertex[turn <= SAME], minlength=count)
    found = straight == np.bincount(sewn, minlength=count)
    found &= (low == high).all(axis=1) & (low[:, 0] < low[:, 1])
    beside = np.full((len(flat), 2), -1)
    beside[point] = around
    return np.asarray(found), beside


def _normals(pattern: Pattern) -> Floats:
    """Return unit normals at flat points, (m, 3): across seams as well where these are smooth."""
    corner, count = pattern.flat_triangles.ravel(), len(pattern.flat_points)
    each = np.repeat(normals(pattern.points, pattern.triangles), 3, axis=0)
    own = np.zeros((count, 3))
    np.add.at(own, corner, each)
    of_point = csr_array((np.ones(count), (np.arange(count), pattern.sewn)))
    of_corner = csr_array((np.ones(len(corner)), (pattern.sewn[corner], np.arange(len(corner)))))
    point, other = (of_point @ of_corner).nonzero()
    one, two = own[point], each[other]
    length = np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    smooth = np.einsum("ij,ij->i", one, two) > np.cos(CREASE) * length
    found = np.zeros((count, 3))
    np.add.at(found, point[smooth], two[smooth])
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


class _MovingMesh:
    """A flat mesh whose vertices move onto borders of polygons.

    Attributes:
        flat: Flat points, (m, 2), in m.
        inner: Whether each vertex is inside a panel, (n,); it has one flat point then.
        slides: Whether each vertex is on a seam or border that goes straight on there, (n,).
        beside: Neighbours of each flat point along seam or border, (m, 2), in the same order on
            both sides of a seam; −1 for others.
        held: Whether each vertex has been moved onto a border of the polygons, (n,).
    """

    def __init__(self, pattern: Pattern, regions: Regions) -> None:
        self.pattern, self.count = pattern, len(pattern.points)
        self.flat = pattern.flat_points.copy()
        edges = edges_of(pattern.flat_triangles)
        self.ends, self.alone = edges.ends, edges.count == 1
        length = lengths(self.flat, self.ends)
        around = pattern.sewn[self.ends].ravel()
        total = np.bincount(around, np.repeat(length, 2), minlength=self.count)
        self._size = total / np.bincount(around, minlength=self.count)
        self.held = np.zeros(self.count, dtype=bool)
        self._sort_vertices()
        self._point = np.zeros(self.count, dtype=np.int64)
        self._point[pattern.sewn] = np.arange(len(self.flat))
        # Panels may overlap in their charts: here they lie apart.
        panel = pattern.panel_of_point
        apart = 2 * float(np.ptp(self.flat[:, 0])) + 4 * float(self._size.max())
        self._shift = np.stack([apart * panel, np.zeros(len(panel))], axis=1)
        step, reach = float(np.median(length)), SAME * pattern.size
        pieces = []
        for k, region in enumerate(regions):
            outline = self.ends[self.alone & (panel[self.ends[:, 0]] == k)]
            pieces.append(_pieces(region, self.flat[outline], step, reach) + [apart * k, 0.0])
        self._pieces = np.concatenate(pieces)
        self._tree = shapely.STRtree(shapely.linestrings(self._pieces))

    @property
    def any_border(self) -> bool:
        """Whether the polygons have a border inside a panel."""
        return len(self._pieces) > 0

    def snap(self) -> None:
        """Move the nearer end of each edge that is cut onto the border, as far as angles allow."""
        refused = self.held.copy()
        edges: Ints = np.arange(len(self.ends), dtype=np.int64)
        while len(edges):
            edges, vertex, move, cost = self._nominated(edges, refused)
            done, bad = self._moved(vertex, move, cost, better=False)
            self.held |= done
            refused |= done | bad
            # Other edges are cut as before.
            near: Bools = np.any((done | bad)[self.pattern.sewn[self.ends]], axis=1)
            near[edges] = True
            edges = np.flatnonzero(near) if len(vertex) else edges[:0]

    def smooth(self) -> None:
        """Move vertices of thin triangles towards the middle of their neighbours."""
        pattern, size = self.pattern, len(self.flat)
        thin = least_angles(self.flat[pattern.flat_triangles]) < GOOD_ANGLE
        vertex = np.unique(pattern.triangles[thin])
        vertex = vertex[self.inner[vertex]]
        one, two = np.concatenate([self.ends, self.ends[:, ::-1]]).T
        degree = np.bincount(one, minlength=size)
        for _ in range(SWEEPS):
            left = vertex
            while len(left):
                point = self._point[left]
                sums = [np.bincount(one, self.flat[two, k], minlength=size) for k in range(2)]
                middle = np.stack(sums, axis=1)[point] / degree[point][:, None]
                held = self.held[left]
                middle[held] = self._nearest(point[held], middle[held])
                move = np.zeros((self.count, 2))
                move[left] = middle - self.flat[point]
                cost = np.linalg.norm(move[left], axis=1) / self._size[left]
                near = (cost > 0) & (cost <= REACH)
                done, bad = self._moved(left[near], move, -cost[near], better=True)
                left = left[near][~(done | bad)[left[near]]]

    def border_directions(self, point: Ints) -> tuple[Floats, Floats]:
        """Return direction and distance of the borders nearest to flat points, (k, 2) and (k,)."""
        at = self.flat[point]
        number = self._tree.nearest(shapely.points(at + self._shift[point]))
        a, b = np.moveaxis(self._pieces[number], 1, 0)
        away = np.linalg.norm(self._nearest(point, at) - at, axis=1)
        return (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True), away

    def _sort_vertices(self) -> None:
        """Find inner vertices, those that may slide, and both neighbours along their borders."""
        border = self.ends[self.alone]
        self.slides, self.beside = straight_on(self.pattern, border)
        self.inner = np.ones(self.count, dtype=bool)
        self.inner[self.pattern.sewn[border]] = False

    def _nominated(self, edges: Ints, refused: Bools) -> tuple[Ints, Ints, Floats, Floats]:
        """Return the cut ones of some edges, vertices to move, and of these moves and costs.

        A move, (n, 2), is a way in the chart; of a vertex that slides, the fraction of the way to
        either neighbour.
        """
        cut, at = self._cuts(edges)
        edge, way = np.concatenate([cut, cut]), np.concatenate([at, 1 - at])
        end, other = np.concatenate([self.ends[cut], self.ends[cut][:, ::-1]]).T
        vertex = self.pattern.sewn[end]
        able = ~refused[vertex] & (self.inner[vertex] | (self.slides[vertex] & self.alone[edge]))
        edge, end, other, way, vertex = (x[able] for x in (edge, end, other, way, vertex))
        inside = self.inner[vertex]
        found = way[:, None] * (self.flat[other] - self.flat[end])
        found[inside] = self._nearest(end[inside], self.flat[end[inside]]) - self.flat[end[inside]]
        cost = np.linalg.norm(found, axis=1) / self._size[vertex]
        found[~inside] = way[~inside, None] * (self.beside[end] == other[:, None])[~inside]
        # Of each edge the nearer end, of each vertex the shortest move.
        kept = np.flatnonzero(cost <= REACH)
        kept = kept[_first(edge[kept], cost[kept], vertex[kept])]
        kept = kept[_first(vertex[kept], cost[kept], edge[kept])]
        move = np.zeros((self.count, 2))
        move[vertex[kept]] = found[kept]
        return np.unique(cut), vertex[kept], move, cost[kept]

    def _cuts(self, edges: Ints) -> tuple[Ints, Floats]:
        """Return those of some edges that borders cut, and where, from 0 at the first end to 1."""
        corners = self.flat[self.ends[edges]] + self._shift[self.ends[edges]]
        edge, piece = self._tree.query(shapely.linestrings(corners), predicate="intersects")
        (a, b), (c, d) = (np.moveaxis(x, 1, 0) for x in (corners[edge], self._pieces[piece]))
        across = np.stack([d[:, 1] - c[:, 1], c[:, 0] - d[:, 0]], axis=1)
        full = np.einsum("ij,ij->i", b - a, across)
        along = np.einsum("ij,ij->i", c - a, across) / np.where(full == 0, np.inf, full)
        inside = (along > NEAR_END) & (along < 1 - NEAR_END)
        return edges[edge[inside]], along[inside]

    def _nearest(self, point: Ints, at: Floats) -> Floats:
        """Return the places on borders nearest to places (k, 2) on the panels of flat points."""
        at = at + self._shift[point]
        a, b = np.moveaxis(self._pieces[self._tree.nearest(shapely.points(at))], 1, 0)
        way = np.einsum("ij,ij->i", at - a, b - a) / np.einsum("ij,ij->i", b - a, b - a)
        return np.asarray(a + np.clip(way, 0, 1)[:, None] * (b - a) - self._shift[point])

    def _moved(
        self, vertex: Ints, move: Floats, cost: Floats, *, better: bool
    ) -> tuple[Bools, Bools]:
        """Move some vertices, no two of them neighbours, the cheapest first.

        `better`: the smallest angle around a vertex must grow. Otherwise no angle may fall below
        the bound. Returned is whether each vertex has been moved, and whether it was tried and
        stays, (n,).
        """
        pattern, count = self.pattern, self.count
        rank = np.full(count, len(vertex))
        rank[vertex[np.lexsort((vertex, cost))]] = np.arange(len(vertex))
        around = np.full(count, len(vertex))
        least = rank[pattern.triangles].min(axis=1)
        np.minimum.at(around, pattern.triangles.ravel(), np.repeat(least, 3))
        tried = (rank == around) & (rank < len(vertex))
        here = np.flatnonzero(tried[pattern.triangles].any(axis=1))
        corner, before = pattern.triangles[here], self.flat.copy()
        self._carry_out(tried, move)
        old, new = (least_angles(x[pattern.flat_triangles[here]]) for x in (before, self.flat))
        if better:
            lows = np.full((2, count), np.inf)
            for low, angle in zip(lows, (old, new), strict=True):
                np.minimum.at(low, corner.ravel(), np.repeat(angle, 3))
            bad = tried & ~(lows[1] > lows[0])
        else:
            bad = np.zeros(count, dtype=bool)
            bad[corner[(new < LEAST_ANGLE) & (new < old)]] = True
            bad &= tried
        back = bad[pattern.sewn]
        self.flat[back] = before[back]
        return tried & ~bad, bad

    def _carry_out(self, moved: Bools, move: Floats) -> None:
        sewn = self.pattern.sewn
        point = np.flatnonzero((moved & self.inner)[sewn])
        self.flat[point] += move[sewn[point]]
        point = np.flatnonzero((moved & ~self.inner)[sewn])
        ways = self.flat[self.beside[point]] - self.flat[point][:, None]
        self.flat[point] += np.einsum("ik,ikj->ij", move[sewn[point]], ways)


def _first(key: Ints, *order: np.ndarray) -> Ints:
    """Return for each key, ascending, the item that comes first in an order."""
    ranked = np.lexsort((*order[::-1], key))
    return ranked[np.unique(key[ranked], return_index=True)[1]]


def _pieces(region: BaseGeometry, outline: Floats, step: float, reach: float) -> Floats:
    """Return the border of a region in short pieces, (s, 2, 2), without that along the outline."""
    if region.is_empty:
        return np.zeros((0, 2, 2))
    border = shapely.get_parts(shapely.segmentize(region.boundary, step))
    points, line = shapely.get_coordinates(border, return_index=True)
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    pieces = pieces[(line[:-1] == line[1:]) & np.any(points[:-1] != points[1:], axis=1)]
    around = shapely.union_all(shapely.linestrings(outline))
    shapely.prepare(around)
    pieces = pieces[~shapely.dwithin(around, shapely.points(pieces.mean(axis=1)), reach)]
    # Those that end on the outline shall cut it in spite of rounding.
    way = np.diff(pieces, axis=1)
    longer = reach * way / np.linalg.norm(way, axis=2, keepdims=True)
    return np.asarray(pieces + longer * [[-1.0], [1.0]], dtype=np.float64)


# ------------------------------------------------------------------------------ moving borders


def border_motion(pattern: Pattern, regions: Regions, printed: Bools, largest: float) -> Floats:
    """Return by which flat points move where a print's borders move outwards by 1, (m, 2).

    Vertices between printed and plain triangles move along the normal of the border. Where a line
    ends at a seam or at the border of its panel they slide along it, both sides of a seam alike.
    The border of a panel is where the print is cut, and does not move. Corners of panels stay, and
    so do vertices where two lines touch. Edges of the pattern follow the regions, by `snapped`, and
    these give the normals. Where the largest way of the borders, in m, to either side, would
    flatten triangles, the motion is less.
    """
    if printed.shape != pattern.panel.shape:
        raise PatternError(
            f"printed has shape {printed.shape}; it must be {pattern.panel.shape}, one entry for "
            "each triangle."
        )
    mesh, flat, sewn = _MovingMesh(pattern, regions), pattern.flat_points, pattern.sewn
    motion, edges = np.zeros_like(flat), edges_of(pattern.flat_triangles)
    border = between(edges, printed)
    if not border.any() or not mesh.any_border:
        return motion
    ends, sides = edges.ends[border], edges.sides[border]
    inside = np.where(printed[sides[:, 0]], sides[:, 0], sides[:, 1])
    way = np.diff(flat[ends], axis=1)[:, 0]
    normal = np.stack([way[:, 1], -way[:, 0]], axis=1) / np.linalg.norm(way, axis=1)[:, None]
    outwards = np.einsum("ij,ij->i", normal, flat[ends].mean(axis=1) - pattern.centroids[inside])
    normal *= np.sign(outwards)[:, None]
    count = np.bincount(ends.ravel(), minlength=len(flat))
    total = np.zeros_like(flat)
    np.add.at(total, ends.ravel(), np.repeat(normal, 2, axis=0))
    at_seam = ~mesh.inner[sewn]
    moves = np.flatnonzero(np.where(at_seam, (count == 1) & mesh.slides[sewn], count == 2))
    size = np.linalg.norm(total[moves], axis=1)
    moves, size = moves[size > SHARP], size[size > SHARP]
    along = total[moves] / size[:, None]
    # Of two unit normals with the sum s the corner moves by 2 s/|s|²: both edges move by 1.
    own = along * np.minimum(count[moves] / size, LONGEST)[:, None]
    direction, away = mesh.border_directions(moves)
    across = np.stack([direction[:, 1], -direction[:, 0]], axis=1)
    turned = np.einsum("ij,ij->i", across, along)
    across *= np.sign(turned)[:, None]
    smooth = (np.abs(turned) > ALIKE) & (away < NEAR * float(np.sqrt(pattern.areas.mean())))
    motion[moves] = np.where(smooth[:, None], across, own)
    _slide(mesh, moves[at_seam[moves]], motion)
    return motion * _allowed(pattern, motion, largest)[sewn][:, None]


def _slide(mesh: _MovingMesh, ends: Ints, motion: Floats) -> None:
    """Let the ends of borders slide along seams and along the borders of panels, in place."""
    flat, sewn = mesh.pattern.flat_points, mesh.pattern.sewn
    point = np.flatnonzero(mesh.beside[:, 1] >= 0)
    along = np.zeros_like(flat)
    way = flat[mesh.beside[point, 1]] - flat[point]
    along[point] = way / np.linalg.norm(way, axis=1, keepdims=True)
    slope = np.einsum("ij,ij->i", motion[ends], along[ends])
    amount = np.clip(1 / np.where(slope == 0, np.inf, slope), -LONGEST, LONGEST)
    share = np.maximum(np.bincount(sewn[ends], minlength=mesh.count), 1)
    mean = np.bincount(sewn[ends], amount, minlength=mesh.count) / share
    both = np.isin(sewn, sewn[ends])
    motion[both] = mean[sewn[both], None] * along[both]


def _allowed(pattern: Pattern, motion: Floats, largest: float) -> Floats:
    """Return which fraction of its way each vertex may go, (n,), so that no triangle gets flat."""
    least = KEPT_ANGLE * least_angles(pattern.corners)
    part = np.ones(len(pattern.points))
    for _ in range(HALVINGS):
        step = largest * part[pattern.sewn][:, None] * motion
        moved = [(pattern.flat_points + way)[pattern.flat_triangles] for way in (-step, step)]
        bad = np.any([least_angles(corners) < least for corners in moved], axis=0)
        if not bad.any():
            return part
        part[np.unique(pattern.triangles[bad])] /= 2
    part[np.unique(pattern.triangles[bad])] = 0.0
    return part
