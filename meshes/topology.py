"""Edges, fans, angles and creases of triangulated surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from toros_fem._types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Edges:
    """Undirected edges of triangles.

    Half-edge 3 t + i runs from corner i to corner i + 1 of triangle t.

    Attributes:
        ends: Vertices of each edge, the smaller first, shape (e, 2).
        of_triangle: Edge from corner i to corner i + 1 of each triangle, shape (t, 3).
        twins: The two half-edges of each edge, the second −1 at a border, shape (e, 2).
        count: Number of triangles at each edge, shape (e,); `twins` holds two of them.
    """

    ends: Ints
    of_triangle: Ints
    twins: Ints
    count: Ints

    @cached_property
    def sides(self) -> Ints:
        """The two triangles at each edge, the second −1 at a border, shape (e, 2)."""
        return self.twins // 3

    @property
    def inner(self) -> Ints:
        """Edges with two triangles."""
        return np.flatnonzero(self.count == 2)

    @property
    def border(self) -> Ints:
        """Edges with one triangle."""
        return np.flatnonzero(self.count == 1)


def edge_keys(ends: Ints, points: int) -> Ints:
    """One number for each undirected edge, from its ends (…, 2) among so many vertices."""
    return np.asarray(ends.min(axis=-1) * np.int64(points) + ends.max(axis=-1))


def half_edges(triangles: Ints) -> Ints:
    """Start and end of half-edge 3 t + i, from corner i to i + 1 of each triangle, (3 t, 2)."""
    return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)


def edges_of(triangles: Ints) -> Edges:
    """The edges of triangles (t, 3)."""
    size = int(triangles.max()) + 1
    keys, number, count = np.unique(
        edge_keys(half_edges(triangles), size), return_inverse=True, return_counts=True
    )
    number = number.ravel()
    order = np.argsort(number, kind="stable")
    start = np.cumsum(count) - count
    twins = np.full((len(keys), 2), -1, dtype=np.int64)
    twins[:, 0] = order[start]
    double = count > 1
    twins[double, 1] = order[start[double] + 1]
    ends = np.stack(np.divmod(keys, size), axis=1)
    return Edges(ends, number.reshape(-1, 3), twins, count)


def users(edges: Edges, edge: int) -> Ints:
    """All triangles at an edge, more than two if it is not manifold."""
    return np.flatnonzero(np.any(edges.of_triangle == edge, axis=1))


def clashing(triangles: Ints, edges: Edges) -> Ints:
    """Edges, (k,), that their two triangles run through in the same direction."""
    start = triangles.ravel()[edges.twins[edges.inner]]
    return edges.inner[start[:, 0] == start[:, 1]]


def pinched(triangles: Ints, edges: Edges) -> Ints:
    """Vertices, (k,), around which consistently oriented triangles make more than one fan."""
    first = np.unique(fans(triangles, edges, edges.inner), return_index=True)[1]
    return np.flatnonzero(np.bincount(triangles.ravel()[first]) > 1)


def pieces(edges: Edges, crossed: Ints) -> Ints:
    """Number of the piece of each triangle, (t,), if one may step across these edges only."""
    size = len(edges.of_triangle)
    one, two = edges.sides[crossed].T
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(size, size))
    label = connected_components(graph, directed=False)[1].astype(np.int64)
    # Numbered by their first triangle, whatever the library's order is.
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse.ravel()].astype(np.int64)


def between(edges: Edges, label: Ints) -> Bools:
    """Whether each edge, (e,), parts triangles of different labels (t,)."""
    one, two = label[edges.sides].T
    return (edges.count == 2) & (one != two)


def components(triangles: Ints) -> Ints:
    """Connected component of each triangle, (t,), by common edges, however many share one."""
    of_triangle = edges_of(triangles).of_triangle
    rows = np.repeat(np.arange(len(triangles)), 3)
    cols = len(triangles) + of_triangle.ravel()
    size = int(cols.max()) + 1
    graph = coo_array((np.ones(len(rows)), (rows, cols)), shape=(size, size))
    label = connected_components(graph, directed=False)[1][: len(triangles)]
    return np.unique(label, return_inverse=True)[1].ravel().astype(np.int64)


def fans(triangles: Ints, edges: Edges, crossed: Ints) -> Ints:
    """Vertices of a mesh cut open: one number for each fan of triangles around a vertex.

    Args:
        triangles: Oriented triangles (t, 3).
        edges: Their edges.
        crossed: Edges that stay whole; all others are cut.

    Returns:
        The fan at each corner, shape (t, 3), numbered by first appearance.
    """
    size = triangles.size
    one, two = edges.twins[crossed].T
    # Corners are numbered as the half-edges they begin; twins run in opposite directions.
    rows = np.concatenate([one, following(one)])
    cols = np.concatenate([following(two), two])
    graph = coo_array((np.ones(len(rows)), (rows, cols)), shape=(size, size))
    label = connected_components(graph, directed=False)[1]
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse.ravel()].reshape(-1, 3).astype(np.int64)


def following(half: Ints) -> Ints:
    """The half-edges that follow others around their triangles."""
    return np.where(half % 3 == 2, half - 2, half + 1)


def normals(points: Floats, triangles: Ints) -> Floats:
    """Normal of each triangle with the length of twice its area, (t, 3)."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return np.cross(b - a, c - a)


def shapes(points: Floats, triangles: Ints) -> Floats:
    """Height over the longest edge of each triangle, (t,): 0.87 if equilateral, 0 if flat."""
    corners = points[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    double = np.linalg.norm(normals(points, triangles), axis=1)
    return double / np.maximum(longest, np.finfo(float).tiny) ** 2


def lengths(points: Floats, ends: Ints) -> Floats:
    """Lengths of edges given by their ends (…, 2), in space or in the plane."""
    return np.asarray(np.linalg.norm(points[ends[..., 1]] - points[ends[..., 0]], axis=-1))


def corner_angles(points: Floats, triangles: Ints) -> Floats:
    """Angle at each corner in rad, (t, 3), in space or in the plane."""
    corners = points[triangles]
    u, v = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    if points.shape[1] == 2:
        sine = np.abs(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
    else:
        sine = np.linalg.norm(np.cross(u, v), axis=2)
    return np.asarray(np.arctan2(sine, np.einsum("tij,tij->ti", u, v)), dtype=np.float64)


def angle_defects(triangles: Ints, edges: Edges, angles: Floats) -> Floats:
    """2π less the angles around each inner vertex, (n,), in rad; 0 at border vertices."""
    count = int(triangles.max()) + 1
    around = np.bincount(triangles.ravel(), angles.ravel(), minlength=count)
    defect: Floats = 2 * np.pi - around.astype(np.float64)
    defect[edges.ends[edges.border]] = 0
    return defect


def dihedral_angles(points: Floats, triangles: Ints, edges: Edges) -> Floats:
    """Angle between the normals of the two triangles of each edge, (e,), in rad; 0 at borders."""
    normal = normals(points, triangles)
    one, two = normal[edges.sides[:, 0]], normal[edges.sides[:, 1]]
    sine = np.linalg.norm(np.cross(one, two), axis=1)
    angle = np.arctan2(sine, np.einsum("ij,ij->i", one, two))
    return np.where(edges.count == 2, angle, 0.0)
