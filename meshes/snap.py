"""Meshes whose edges follow the borders of polygons: vertices nearby are moved onto them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely
from mpi4py import MPI
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import PanelError
from toros_fem.base.mpi import on_first_rank
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import edges_of, normals

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


def snapped(comm: MPI.Comm, pattern: Pattern, regions: Sequence[BaseGeometry]) -> Pattern:
    """Return the same triangles with vertices moved onto the borders of polygons (collective).

    Of each edge that a border cuts, the nearer end is moved onto it in the flat chart, if all
    triangles around keep angles of at least 18°. Vertices on a seam or a free border slide along
    it, both sides of a seam alike, and stay where it turns: outlines and seams are kept. In the
    assembled shape a vertex moves along the curved surface that the normals of its panel suggest.

    Args:
        comm: Communicator.
        pattern: The pattern, with edges that are not much longer than the polygons are wide.
        regions: Polygons on each panel, in m.

    Raises:
        PanelError: The number of regions is not that of the panels.
    """

    def move() -> Pattern:
        if len(regions) != len(pattern.panel_names):
            raise PanelError(
                f"there are {len(regions)} regions for {len(pattern.panel_names)} panels; give "
                "one for each panel, an empty polygon where nothing is printed."
            )
        mesh = MovingMesh(pattern, regions)
        for turn in range(ROUNDS if mesh.any_border else 0):
            if turn:
                mesh.smooth()
            mesh.snap()
        return with_flat_points(pattern, mesh.flat)

    return on_first_rank(comm, move)


def with_flat_points(pattern: Pattern, flat: Floats) -> Pattern:
    """Return the same triangles with flat points that have moved within their panels.

    In the assembled shape a vertex moves along the curved surface that the normals of its panel
    suggest.

    Args:
        pattern: The pattern.
        flat: Its flat points, (m, 2), in m. Those of a vertex on a seam have moved alike.
    """
    edges = edges_of(pattern.flat_triangles)
    inner = np.ones(len(pattern.points), dtype=bool)
    inner[pattern.sewn[edges.ends[edges.border]]] = False
    return replace(pattern, flat_points=flat, points=_places(pattern, flat, inner))


class MovingMesh:
    """A flat mesh whose vertices move onto borders of polygons.

    Attributes:
        flat: Flat points, (m, 2), in m.
        inner: Whether each vertex is inside a panel, (n,); it has one flat point then.
        slides: Whether each vertex is on a seam or border that goes straight on there, (n,).
        beside: Neighbours of each flat point along seam or border, (m, 2), in the same order on
            both sides of a seam; −1 for others.
        held: Whether each vertex has been moved onto a border of the polygons, (n,).
    """

    def __init__(self, pattern: Pattern, regions: Sequence[BaseGeometry]) -> None:
        self.pattern, self.count = pattern, len(pattern.points)
        self.flat = pattern.flat_points.copy()
        edges = edges_of(pattern.flat_triangles)
        self.ends, self.alone = edges.ends, edges.count == 1
        length = np.linalg.norm(np.diff(self.flat[self.ends], axis=1)[:, 0], axis=1)
        around = pattern.sewn[self.ends].ravel()
        total = np.bincount(around, np.repeat(length, 2), minlength=self.count)
        self._size = total / np.bincount(around, minlength=self.count)
        self.held = np.zeros(self.count, dtype=bool)
        self._sort_vertices()
        self._point = np.zeros(self.count, dtype=np.int64)
        self._point[pattern.sewn] = np.arange(len(self.flat))
        # Panels may overlap in their charts: here they lie apart.
        panel = _panel_of_points(pattern)
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
                middle = np.stack(
                    [np.bincount(one, self.flat[two, k], minlength=size) for k in range(2)], axis=1
                )[point] / degree[point][:, None]  # fmt: skip
                held = self.held[left]
                middle[held] = self._nearest(point[held], middle[held])
                move = np.zeros((self.count, 2))
                move[left] = middle - self.flat[point]
                cost = np.linalg.norm(move[left], axis=1) / self._size[left]
                near = (cost > 0) & (cost <= REACH)
                done, bad = self._moved(left[near], move, -cost[near], better=True)
                left = left[near][~(done | bad)[left[near]]]

    def _sort_vertices(self) -> None:
        """Find inner vertices, those that may slide, and both neighbours along their borders."""
        sewn, border = self.pattern.sewn, self.ends[self.alone]
        both = np.concatenate([border, border[:, ::-1]])
        both = both[np.lexsort((sewn[both[:, 1]], both[:, 0]))]
        both = both[np.bincount(border.ravel(), minlength=len(self.flat))[both[:, 0]] == 2]
        point, around = both[::2, 0], both[:, 1].reshape(-1, 2)
        one, two = (self.flat[around[:, i]] - self.flat[point] for i in range(2))
        turn = np.abs(np.arctan2(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0],
                                 -np.einsum("ij,ij->i", one, two)))  # fmt: skip
        # All flat points of a vertex that slides have the same two neighbours.
        vertex, beside = sewn[point], sewn[around]
        low, high = np.full((self.count, 2), self.count), np.full((self.count, 2), -1)
        np.minimum.at(low, vertex, beside)
        np.maximum.at(high, vertex, beside)
        straight = np.bincount(vertex[turn <= SAME], minlength=self.count)
        self.slides = straight == np.bincount(sewn, minlength=self.count)
        self.slides &= (low == high).all(axis=1) & (low[:, 0] < low[:, 1])
        self.inner = np.ones(self.count, dtype=bool)
        self.inner[sewn[border]] = False
        self.beside = np.full((len(self.flat), 2), -1)
        self.beside[point] = around

    def _nominated(self, edges: Ints, refused: Bools) -> tuple[Ints, Ints, Floats, Floats]:
        """Return the cut ones of some edges, vertices to move, and of these moves and costs.

        A move, (n, 2), is a way in the chart; of a vertex that slides, the fraction of the way to
        either neighbour.
        """
        sewn = self.pattern.sewn
        cut, at = self._cuts(edges)
        edge = np.concatenate([cut, cut])
        end, other = np.concatenate([self.ends[cut], self.ends[cut][:, ::-1]]).T
        way = np.concatenate([at, 1 - at])
        vertex = sewn[end]
        able = ~refused[vertex] & (self.inner[vertex] | (self.slides[vertex] & self.alone[edge]))
        edge, end, other, way, vertex = (x[able] for x in (edge, end, other, way, vertex))
        inside = self.inner[vertex]
        target = self.flat[end] + way[:, None] * (self.flat[other] - self.flat[end])
        target[inside] = self._nearest(end[inside], self.flat[end[inside]])
        found = target - self.flat[end]
        cost = np.linalg.norm(found, axis=1) / self._size[vertex]
        found[~inside] = way[~inside, None] * (self.beside[end] == other[:, None])[~inside]
        # Of each edge the nearer end, of each vertex the shortest move.
        kept = np.flatnonzero(cost <= REACH)
        kept = kept[np.lexsort((vertex[kept], cost[kept], edge[kept]))]
        kept = kept[np.unique(edge[kept], return_index=True)[1]]
        kept = kept[np.lexsort((edge[kept], cost[kept], vertex[kept]))]
        kept = kept[np.unique(vertex[kept], return_index=True)[1]]
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

    def border_directions(self, point: Ints) -> tuple[Floats, Floats]:
        """Return direction and distance of the borders nearest to flat points, (k, 2) and (k,)."""
        at = self.flat[point]
        number = self._tree.nearest(shapely.points(at + self._shift[point]))
        a, b = np.moveaxis(self._pieces[number], 1, 0)
        away = np.linalg.norm(self._nearest(point, at) - at, axis=1)
        return (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True), away

    def _moved(
        self, vertex: Ints, move: Floats, cost: Floats, *, better: bool
    ) -> tuple[Bools, Bools]:
        """Move vertices of which no two are neighbours, the cheapest first.

        Args:
            vertex: Vertices that would move.
            move: Moves of all vertices, as of `_nominated`.
            cost: Cost of the moves of `vertex`.
            better: Whether the smallest angle around a vertex must grow. Otherwise no angle may
                fall below the bound.

        Returns:
            Whether each vertex has been moved, and whether it was tried and stays, (n,).
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


def _panel_of_points(pattern: Pattern) -> Ints:
    panel: npt.NDArray[np.int64] = np.zeros(len(pattern.flat_points), dtype=np.int64)
    panel[pattern.flat_triangles] = pattern.panel[:, None]
    return panel


def least_angles(corners: Floats) -> Floats:
    """Return the smallest angle of triangles (k, 3, 2) in rad; negative where clockwise."""
    u, v = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    sine = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return np.asarray(np.arctan2(sine, np.einsum("tij,tij->ti", u, v)).min(axis=1))


def _places(pattern: Pattern, flat: Floats, inner: Bools) -> Floats:
    """Return the assembled places of moved flat points, (n, 3), in m.

    Boubekeur and Alexa, "Phong tessellation" (ACM TOG 27(5), 2008), with the factor 1/2, by which
    an arc comes out to third order. Vertices on borders stay on the edges between vertices.
    """
    points, panel = pattern.points.copy(), _panel_of_points(pattern)
    moved = np.flatnonzero(np.any(flat != pattern.flat_points, axis=1))
    normal, corner = _normals(pattern), pattern.flat_triangles
    for number in np.unique(panel[moved]):
        here, cells = moved[panel[moved] == number], np.flatnonzero(pattern.panel == number)
        near = min(NEIGHBOURS, len(cells))
        found = cKDTree(pattern.centroids[cells]).query(flat[here], k=near)[1]
        around = cells[np.reshape(found, (len(here), near))]
        a, b, c = np.moveaxis(pattern.corners[around], 2, 0)
        u, v, w = b - a, c - a, flat[here][:, None] - a
        area = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        second = (w[..., 0] * v[..., 1] - w[..., 1] * v[..., 0]) / area
        third = (u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]) / area
        weights = np.stack([1 - second - third, second, third], axis=2)
        row, best = np.arange(len(here)), np.argmax(weights.min(axis=2), axis=1)
        weight, flat_corner = weights[row, best], corner[around[row, best]]
        corners, up = pattern.points[pattern.sewn[flat_corner]], normal[flat_corner]
        place = np.einsum("ij,ijk->ik", weight, corners)
        off = np.einsum("ijk,ijk->ij", place[:, None] - corners, up)
        vertex = pattern.sewn[here]
        bulge = 0.5 * np.einsum("ij,ij,ijk->ik", weight, off, up)
        points[vertex] = place - bulge * inner[vertex][:, None]
    return points


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
