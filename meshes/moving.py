"""Meshes whose flat points move within their panels, and with the borders of a print."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from scipy.sparse import csr_array

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import (
    barycentric,
    between,
    cross,
    edges_of,
    least_angles,
    normals,
)

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
