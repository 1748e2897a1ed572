"""Panels in the plane: maps, places beside each other, cuts, points that move, meshes by gmsh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from threading import RLock
from typing import Any, Self, TypeAlias

import numpy as np
import numpy.typing as npt
import shapely
from scipy.sparse import csr_array
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import (
    barycentric,
    between,
    cross,
    edges_of,
    flat_areas,
    least_angles,
    normals,
)

# Entries of a rotation this close to a whole number are that number: quarter turns are exact, and
# a rectangle that just fits still does after one.
EXACT = 1e-12
Polygons: TypeAlias = npt.NDArray[np.object_]
# Gap between panels as a fraction of the side of a square of their whole area.
GAP = 0.04
# Widths of rows over this side: of panels turned upright, and of panels as they are.
UPRIGHT_WIDTH, ROW_WIDTH = 1.3, 2.5
# Panels whose bounding boxes are closer than this fraction of the drawing's size touch.
TOUCHING = 1e-6
# Panels are turned in a picture if it becomes this many times larger.
LARGER = 1.1
# Rounding that two sizes may differ by, in m.
FITS = 1e-9
# Number of widths of rows that are tried.
WIDTHS = 12
# Corners of the pieces that a region is divided into before it is cut by triangles.
PIECE = 40
# An outline that turns by less than this goes straight on, in rad.
SAME = 1e-7
# Triangles whose normals differ by more than this do not belong to the same smooth surface, in rad.
CREASE = np.radians(45.0)
# A corner of a border moves by at most this multiple of the border's own way.
LONGEST = 2.0
# A spike whose normals sum up to less than this stays.
SHARP = 1e-3
# Angles may shrink to this fraction of what they were; where they would, the way is halved, so
# many times at most.
KEPT_ANGLE, HALVINGS = 0.4, 6
MODEL = "toros_fem"
# gmsh has one current model in a process.
_ALONE = RLock()


@dataclass(frozen=True, eq=False)
class Affine:
    """The map x → matrix · x + offset of points in the plane, in m."""

    matrix: Floats
    offset: Floats

    @classmethod
    def shift(cls, offset: npt.ArrayLike) -> Self:
        """Return the translation by an offset, (2,), in m."""
        return cls(np.eye(2), np.asarray(offset, dtype=np.float64))

    @classmethod
    def turn(cls, angle: float, offset: npt.ArrayLike = (0.0, 0.0)) -> Self:
        """Return the rotation about the origin by an angle in rad, then a translation in m."""
        entries = np.array([np.cos(angle), np.sin(angle)])
        whole = np.round(entries)
        c, s = np.where(np.abs(entries - whole) < EXACT, whole, entries)
        return cls(np.array([[c, -s], [s, c]]), np.asarray(offset, dtype=np.float64))

    @classmethod
    def mirror(cls) -> Self:
        """Return the reflection (x, y) → (−x, y)."""
        return cls(np.diag([-1.0, 1.0]), np.zeros(2))

    @classmethod
    def fit(cls, source: Floats, target: Floats) -> Self:
        """Return the map that takes points (k, 2) to others, with the least sum of squares."""
        middle = source.mean(axis=0)
        columns = np.column_stack([source - middle, np.ones(len(source))])
        found = np.linalg.lstsq(columns, target, rcond=None)[0]
        matrix = found[:2].T
        return cls(matrix, found[2] - matrix @ middle)

    @property
    def angle(self) -> float:
        """Direction of the image of the x axis in rad."""
        return float(np.arctan2(self.matrix[1, 0], self.matrix[0, 0]))

    @property
    def inverse(self) -> Self:
        """The map back; a LinAlgError where the map takes the plane to a line."""
        back = np.asarray(np.linalg.inv(self.matrix), dtype=np.float64)
        return type(self)(back, -back @ self.offset)

    def __matmul__(self, first: Affine) -> Self:
        """Return the map that applies `first`, then this one."""
        return type(self)(self.matrix @ first.matrix, self.vectors(first.offset) + self.offset)

    def points(self, points: npt.ArrayLike) -> Floats:
        """Return the images of points, (…, 2), in m."""
        return self.vectors(points) + self.offset

    def vectors(self, vectors: npt.ArrayLike) -> Floats:
        """Return the images of differences of points, (…, 2)."""
        return np.asarray(np.asarray(vectors, dtype=np.float64) @ self.matrix.T)

    def region(self, region: BaseGeometry) -> BaseGeometry:
        """Return the image of a geometry."""
        return affine_transform(region, [*self.matrix.ravel(), *self.offset])


# --------------------------------------------------------------------------- beside each other


def arranged(panels: Sequence[Floats]) -> list[Floats]:
    """Turn panels, given by flat points (m, 2), upright, and pack them in rows.

    They are rotated and translated into the first quadrant, in m. No two overlap.
    """
    upright = [_upright(points) for points in panels]
    sizes = np.array([points.max(axis=0) for points in upright])
    side = float(np.sqrt(sizes.prod(axis=1).sum()))
    corners = _in_rows(sizes, UPRIGHT_WIDTH * side, GAP * side)
    return [points + corner for points, corner in zip(upright, corners, strict=True)]


def panel_places(
    pattern: Pattern, gap: float, page: tuple[float, float] | None = None
) -> list[Affine]:
    """Return the maps of all panels into a picture, whose lower left corner is the origin.

    Panels that are apart in the flat plane, as those of `unwrap`, keep their places beside each
    other. Others, as those of `cylinder`, are packed in rows, with a gap in m.

    On a page, of a width and height in any unit, all become as large as possible: slim panels may
    be turned by 90° clockwise, all alike, and small ones stand above each other.
    """
    corners = [
        pattern.corners[pattern.panel == panel].reshape(-1, 2)
        for panel in range(len(pattern.panel_names))
    ]
    best: tuple[float, list[Affine]] = 0.0, []
    for angle in (0.0, -np.pi / 2) if page else (0.0,):
        here = Affine.turn(angle)
        low = np.array([here.points(points).min(axis=0) for points in corners])
        high = np.array([here.points(points).max(axis=0) for points in corners])
        sizes = high - low
        if _apart(low, high):
            packed = [low - low.min(axis=0)]
        elif page:
            widths = np.linspace(sizes[:, 0].max(), (sizes[:, 0] + gap).sum(), WIDTHS)
            packed = [_in_rows(sizes, float(width), gap, stacked=True) for width in widths]
        else:
            packed = [_in_rows(sizes, ROW_WIDTH * float(np.sqrt(sizes.prod(axis=1).sum())), gap)]
        for lower in packed:
            scale = float((np.array(page or (1, 1)) / (lower + sizes).max(axis=0)).min())
            first_turned = angle != 0 and best[1][0].angle == 0
            if scale > best[0] * (LARGER if first_turned else 1 + 1e-9):
                best = scale, [Affine.turn(angle, offset) for offset in lower - low]
    return best[1]


def _apart(low: Floats, high: Floats) -> bool:
    """Return whether no two boxes, given by their corners (p, 2), overlap or touch."""
    near = TOUCHING * float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    gaps = np.maximum(low[:, None] - high, low - high[:, None]).max(axis=2)
    return bool(np.all(gaps[np.triu_indices(len(low), 1)] > near))


def _in_rows(sizes: Floats, width: float, gap: float, *, stacked: bool = False) -> Floats:
    """Return the lower left corner of each rectangle, (p, 2), in rows of about this width.

    If they are stacked, lower rectangles stand above each other in a row as far as they fit.
    """
    width = max(width, float(sizes[:, 0].max()))
    corners = np.zeros_like(sizes)
    corner, height = np.zeros(2), 0.0
    below: int | None = None  # the last one of the row, if another may stand on it
    for k in np.argsort(-sizes[:, 1].round(9), kind="stable"):  # the tallest first
        size = sizes[k]
        if stacked and below is not None:
            above = corners[below] + [0, sizes[below, 1] + gap]
            if above[1] + size[1] <= corner[1] + height and size[0] <= sizes[below, 0] + FITS:
                corners[k], below = above, k
                continue
        if corner[0] > 0 and corner[0] + size[0] > width:
            corner, height = np.array([0.0, corner[1] + height + gap]), 0.0
        corners[k], below = corner, k
        corner = corner + [size[0] + gap, 0]
        height = max(height, float(size[1]))
    return corners


def _upright(points: Floats) -> Floats:
    """Return points turned so that their narrowest rectangle is upright, from the origin."""
    corners = shapely.get_coordinates(shapely.oriented_envelope(shapely.MultiPoint(points)))
    sides = np.diff(corners[:3], axis=0)
    long = sides[np.argmax(np.linalg.norm(sides, axis=1))]
    turn = np.exp(1j * (np.pi / 2 - np.arctan2(long[1], long[0])))
    place = (points @ [1, 1j]) * turn
    turned = np.column_stack([place.real, place.imag])
    return turned - turned.min(axis=0)


# ---------------------------------------------------------------------------- cut by triangles


def cut_by_triangles(region: BaseGeometry, corners: Floats) -> tuple[Ints, Polygons]:
    """Return the parts of a region in triangles (t, 3, 2), polygons that only share borders.

    The triangle of each polygon, (k,), comes first.
    """
    triangles, pieces = shapely.polygons(corners), _divided(region)
    triangle, piece = shapely.STRtree(pieces).query(triangles, predicate="intersects")
    parts = shapely.intersection(triangles[triangle], pieces[piece])
    parts, origin = shapely.get_parts(parts, return_index=True)
    flat = _are_polygons(parts)
    return triangle[origin[flat]], parts[flat]


def polygons_of(shape: BaseGeometry) -> Polygons:
    """Return the polygons of a shape, without its lines and points."""
    parts = shapely.get_parts(shape)
    return parts[_are_polygons(parts)]


def runs_of_ring(
    points: Floats, cut: BaseGeometry, near: float
) -> list[tuple[Floats, bool]] | None:
    """Return the runs of a ring (n, 2) from one point on a cut to the next, each with both.

    With each run comes whether it is off the cut. Points closer than `near`, in m, lie on the cut;
    None where no point does.
    """
    free = ~shapely.dwithin(cut, shapely.points(points), near)
    if free.all():
        return None
    begin = int(np.argmin(free))
    closed = np.roll(points, -begin, axis=0)
    closed = np.concatenate([closed, closed[:1]])
    stops, found = np.append(np.flatnonzero(~np.roll(free, -begin)), len(points)), []
    for a, b in pairwise(stops):
        run = closed[a : b + 1]
        # A single edge lies on the cut, or leads across the panel.
        off = b > a + 1 or not shapely.dwithin(cut, shapely.Point(run.mean(axis=0)), near)
        found.append((run, bool(off)))
    return found


def _are_polygons(parts: Polygons) -> Bools:
    return np.asarray(shapely.get_type_id(parts) == shapely.GeometryType.POLYGON)


def _divided(region: BaseGeometry) -> Polygons:
    """Return pieces of a region with few corners each; they only share borders."""
    done: list[BaseGeometry] = []
    left = list(shapely.get_parts(region))
    while left:
        part = left.pop()
        if part.geom_type != "Polygon" or part.is_empty:
            continue
        if shapely.get_num_coordinates(part) <= PIECE:
            done.append(part)
            continue
        x, y, right, top = part.bounds
        if right - x > top - y:
            middle = (x + right) / 2
            halves = (x, y, middle, top), (middle, y, right, top)
        else:
            middle = (y + top) / 2
            halves = (x, y, right, middle), (x, middle, right, top)
        for half in halves:
            left += list(shapely.get_parts(shapely.intersection(part, shapely.box(*half))))
    return np.array(done, dtype=object)


# --------------------------------------------------------------------- points that move in panels


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
    """Return unit normals at flat points, (m, 3): across seams as well where these are smooth.

    They are 0 where no triangle has about the mean normal, as on a torus that lies flat.
    """
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
    size = np.linalg.norm(found, axis=1, keepdims=True)
    return np.asarray(found / np.where(size > 0, size, 1.0))


# ------------------------------------------------------------------------------ moving borders


def border_motion(pattern: Pattern, printed: Bools, largest: float) -> Floats:
    """Return by which flat points move where a print's borders move outwards by 1, (m, 2).

    Vertices between printed and plain triangles move so that the edges on both sides move by 1.
    Where a line ends at a seam or at the border of its panel they slide along it, both sides of a
    seam alike. The border of a panel is where the print is cut, and does not move. Corners of
    panels stay, and so do vertices where two lines touch. Where the largest way of the borders, in
    m, to either side, would flatten triangles, the motion is less.
    """
    flat, sewn, edges = pattern.flat_points, pattern.sewn, edges_of(pattern.flat_triangles)
    motion, border = np.zeros_like(flat), between(edges, printed)
    if not border.any():
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
    outline = edges.ends[edges.border]
    slides, beside = straight_on(pattern, outline)
    on_outline = np.isin(sewn, sewn[outline])
    moves = np.flatnonzero(np.where(on_outline, (count == 1) & slides[sewn], count == 2))
    size = np.linalg.norm(total[moves], axis=1)
    moves, size = moves[size > SHARP], size[size > SHARP]
    # Of two unit normals with the sum s the corner moves by 2 s/|s|²: both edges move by 1.
    amount = np.minimum(count[moves] / size, LONGEST)
    motion[moves] = (amount / size)[:, None] * total[moves]
    _slide(pattern, moves[on_outline[moves]], beside, motion)
    return motion * _allowed(pattern, motion, largest)[sewn][:, None]


def _slide(pattern: Pattern, ends: Ints, beside: Ints, motion: Floats) -> None:
    """Let the ends of borders slide along seams and along the borders of panels, in place.

    `beside` are the neighbours of each flat point along them, as of `straight_on`.
    """
    flat, sewn, count = pattern.flat_points, pattern.sewn, len(pattern.points)
    point = np.flatnonzero(beside[:, 1] >= 0)
    along = np.zeros_like(flat)
    way = flat[beside[point, 1]] - flat[point]
    along[point] = way / np.linalg.norm(way, axis=1, keepdims=True)
    slope = np.einsum("ij,ij->i", motion[ends], along[ends])
    amount = np.clip(1 / np.where(slope == 0, np.inf, slope), -LONGEST, LONGEST)
    share = np.maximum(np.bincount(sewn[ends], minlength=count), 1)
    mean = np.bincount(sewn[ends], amount, minlength=count) / share
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


# --------------------------------------------------------------------------------- meshes by gmsh


@contextmanager
def gmsh_model(edge_length: float, options: Mapping[str, float] | None = None) -> Iterator[Any]:
    """Open an empty model whose mesh has edges of a length in m, and drop it (one rank).

    It yields the module `gmsh`, whose session, options and models of others are left as they were;
    other threads wait until the model is dropped. The options are further ones, by their names.
    """
    import gmsh  # here, because it is slow, and structured meshes do not need it

    wanted = {
        "General.Terminal": 0, "General.NumThreads": 1, "Mesh.Algorithm": 6, "Mesh.RandomSeed": 1,
        "Mesh.MeshSizeMin": edge_length, "Mesh.MeshSizeMax": edge_length, **(options or {}),
    }  # fmt: skip
    with _ALONE:
        ours = not gmsh.isInitialized()
        if ours:
            gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
        current = "" if ours else gmsh.model.getCurrent()
        before = {name: gmsh.option.getNumber(name) for name in wanted}
        try:
            for name, value in wanted.items():
                gmsh.option.setNumber(name, value)
            gmsh.model.add(MODEL)
            try:
                yield gmsh
            finally:
                gmsh.model.setCurrent(MODEL)
                gmsh.model.remove()
        finally:
            for name, value in before.items():
                gmsh.option.setNumber(name, value)
            if ours:
                gmsh.finalize()
            elif current:
                gmsh.model.setCurrent(current)


def meshed(gmsh: Any) -> tuple[Floats, Ints, Ints]:
    """Mesh the surfaces of the current model.

    Returned are the points (n, 3) that triangles use, the triangles (t, 3), and the edges on the
    model's curves whose ends are among the points, (k, 2).
    """
    gmsh.model.mesh.generate(2)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    corners = gmsh.model.mesh.getElementsByType(2)[1]
    ends = gmsh.model.mesh.getElementsByType(1)[1].reshape(-1, 2)
    used, triangles = np.unique(corners, return_inverse=True)
    place = np.argsort(tags)[np.searchsorted(np.sort(tags), used)]
    ends = ends[np.isin(ends, used).all(axis=1)]
    return (
        np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[place],
        triangles.reshape(-1, 3).astype(np.int64),
        np.searchsorted(used, ends).astype(np.int64),
    )


def faces_mesh(
    corners: Floats, faces: Sequence[Sequence[Sequence[int]]], edge_length: float
) -> tuple[Floats, Ints, Ints]:
    """Mesh polygons with holes that share corners and sides (one rank: gmsh is serial).

    Each side stays one edge; inside, edges have the length in m whatever the sides have. A face is
    a list of rings of corners, numbers among (k, 2) in m, the outer one first. Returned are flat
    points (m, 2) in m, the corners first, counter-clockwise triangles (t, 3), and the face of each.
    """
    options = {"Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeMin": 0.0}
    with gmsh_model(edge_length, options) as gmsh:
        geo = gmsh.model.geo
        points = [geo.addPoint(x, y, 0, edge_length) for x, y in corners]
        sides: dict[tuple[int, int], int] = {}

        def loop(ring: Sequence[int]) -> int:
            found = []
            for a, b in zip(ring, [*ring[1:], ring[0]], strict=True):
                if (b, a) not in sides:
                    sides[a, b] = geo.addLine(points[a], points[b])
                    geo.mesh.setTransfiniteCurve(sides[a, b], 2)
                found.append(sides[a, b] if (a, b) in sides else -sides[b, a])
            return int(geo.addCurveLoop(found))

        surfaces = [geo.addPlaneSurface([loop(ring) for ring in rings]) for rings in faces]
        geo.synchronize()
        gmsh.model.mesh.generate(2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        ends = [gmsh.model.mesh.getElementsByType(2, tag)[1].reshape(-1, 3) for tag in surfaces]
    # A point of the model is the node of the same number.
    place = np.argsort(tags, kind="stable")
    flat = places.reshape(-1, 3)[place, :2]
    triangles = np.searchsorted(tags[place], np.concatenate(ends)).astype(np.int64)
    face = np.repeat(np.arange(len(faces)), [len(one) for one in ends])
    clockwise = flat_areas(flat[triangles]) < 0
    return flat, np.where(clockwise[:, None], triangles[:, ::-1], triangles), face
