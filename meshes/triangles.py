"""Triangles: edges, fans, regions, angles, shape functions, and how many there may be."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, sparray
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import SuperLU, splu
from scipy.spatial import cKDTree

from toros_fem.base.errors import MeshSizeError, PatternError
from toros_fem.base.validation import Bools, Floats, Ints, require_count

# Such a skin needs about 50 GB: docs/command_line.md.
MOST_TRIANGLES = 2_000_000
# How a larger one is allowed.
ALLOW = (
    "or, where the memory is there, allow it by --allow-large or "
    "`with toros_fem.meshes.triangle_limit(None):`."
)
# Area of an equilateral triangle over the square of its edge.
EQUILATERAL = np.sqrt(3) / 4

_most: ContextVar[int | None] = ContextVar("toros_most_triangles", default=MOST_TRIANGLES)

# ------------------------------------------------------------------------------------- topology


@dataclass(frozen=True, eq=False)
class Edges:
    """Undirected edges of triangles.

    Half-edge 3 t + i runs from corner i to corner i + 1 of triangle t.

    Attributes:
        ends: Vertices of each edge, the smaller first, shape (e, 2).
        of_triangle: Edge from corner i to corner i + 1 of each triangle, shape (t, 3).
        twins: The two half-edges of each edge, the second −1 at a border, shape (e, 2).
        count: Number of triangles at each edge, shape (e,); `twins` has two of them.
    """

    ends: Ints
    of_triangle: Ints
    twins: Ints
    count: Ints

    @cached_property
    def sides(self) -> Ints:
        """The two triangles at each edge, the second −1 at a border, shape (e, 2)."""
        return self.twins // 3

    @cached_property
    def inner(self) -> Ints:
        """Edges with two triangles."""
        return np.flatnonzero(self.count == 2)

    @cached_property
    def border(self) -> Ints:
        """Edges with one triangle."""
        return np.flatnonzero(self.count == 1)


def edge_keys(ends: Ints, points: int) -> Ints:
    """Return one number for each undirected edge (…, 2) between this many points."""
    return np.asarray(ends.min(axis=-1) * np.int64(points) + ends.max(axis=-1))


def half_edges(triangles: Ints) -> Ints:
    """Return start and end of half-edge 3 t + i, from corner i to i + 1 of triangle t, (3 t, 2)."""
    return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)


def following(half: Ints) -> Ints:
    """Return the half-edge that follows each of the given ones around its triangle."""
    return np.where(half % 3 == 2, half - 2, half + 1)


def opposite_edges(triangles: np.ndarray) -> Ints:
    """Return the ends of the edge opposite each corner i, corners i + 1 and i + 2, (t, 3, 2)."""
    return np.stack([np.roll(triangles, -1, axis=1), np.roll(triangles, -2, axis=1)], axis=2)


def edges_of(triangles: Ints) -> Edges:
    """Return the edges of triangles (t, 3)."""
    size = int(triangles.max(initial=-1)) + 1
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


def linked(one: Ints, two: Ints, size: int) -> Ints:
    """Return the connected component of each of `size` nodes, numbered by its first node.

    The k-th link is between the nodes one[k] and two[k].
    """
    graph = coo_array((np.ones(len(one)), (one, two)), shape=(size, size))
    label = connected_components(graph, directed=False)[1].astype(np.int64)
    # The order is made here: the library does not document its own.
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse.ravel()].astype(np.int64)


def coincident(points: Floats, tolerance: float) -> Ints:
    """Return the number of the place of each point, (n,): those within the tolerance share one."""
    pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    return linked(pairs[:, 0], pairs[:, 1], len(points))


def connected_regions(edges: Edges, crossed: Ints) -> Ints:
    """Return the region of each triangle, (t,), where only the given edges join neighbours."""
    one, two = edges.sides[crossed].T
    return linked(one, two, len(edges.of_triangle))


def between(edges: Edges, label: Ints | Bools) -> Bools:
    """Return whether each edge, (e,), separates triangles of different labels (t,)."""
    one, two = label[edges.sides].T
    return (edges.count == 2) & (one != two)


def surface_components(triangles: Ints) -> Ints:
    """Return the connected component of each triangle, (t,), also across edges with many."""
    count = len(triangles)
    edge = count + edges_of(triangles).of_triangle.ravel()
    return linked(np.repeat(np.arange(count), 3), edge, int(edge.max()) + 1)[:count]


def fans(triangles: Ints, edges: Edges, crossed: Ints) -> Ints:
    """Return the vertex at each corner, (t, 3), of a mesh that is cut along all but some edges.

    A vertex is a fan of triangles, which the edges `crossed` join. They are numbered by first
    appearance.
    """
    one, two = edges.twins[crossed].T
    # Corners are numbered as the half-edges they begin; twins run in opposite directions.
    rows = np.concatenate([one, following(one)])
    cols = np.concatenate([following(two), two])
    return linked(rows, cols, triangles.size).reshape(-1, 3)


def clashing(triangles: Ints, edges: Edges) -> Ints:
    """Return the edges, (k,), that both their triangles pass in the same direction."""
    start = triangles.ravel()[edges.twins[edges.inner]]
    return edges.inner[start[:, 0] == start[:, 1]]


def require_two_at_edges(points: Floats, edges: Edges) -> None:
    """Check that no edge has more than two triangles; a PatternError names the first that has."""
    many = np.flatnonzero(edges.count > 2)
    if len(many):
        a, b = edges.ends[many[0]]
        users = np.flatnonzero(np.any(edges.of_triangle == many[0], axis=1))
        raise PatternError(
            f"{len(many)} edges have more than two triangles, the first between vertices {a} and "
            f"{b} at {points[[a, b]].mean(axis=0)} m with triangles {users.tolist()}. A skin has "
            "one inside and one outside: correct the seams, remove inner walls, or export the "
            "outer hull alone."
        )


def require_manifold(points: Floats, triangles: Ints, edges: Edges, remedy: str) -> None:
    """Check that triangles form a surface, and neighbours have the same orientation.

    The remedy is for neighbours that are oriented differently.
    """
    require_two_at_edges(points, edges)
    for fault in _faults(points, triangles, edges, remedy):
        raise PatternError(fault)


def _faults(points: Floats, triangles: Ints, edges: Edges, remedy: str) -> Iterator[str]:
    """Yield what keeps triangles, at most two at an edge, from forming a surface, as sentences."""
    wrong = clashing(triangles, edges)
    if len(wrong):
        (one, two), (a, b) = edges.sides[wrong[0]], half_edges(triangles)[edges.twins[wrong[0], 0]]
        yield (
            f"triangles {one} and {two} pass their common edge {a}-{b} in the same direction. "
            f"{remedy}"
        )
    first = np.unique(fans(triangles, edges, edges.inner), return_index=True)[1]
    pinched = np.flatnonzero(np.bincount(triangles.ravel()[first]) > 1)
    if len(pinched):
        yield (
            f"vertex {pinched[0]} at {points[pinched[0]]} m joins fans of triangles that share no "
            "edge there; the surface pinches to a point. Separate the fans."
        )


# --------------------------------------------------------------------------- lengths and angles


def lengths(points: Floats, ends: Ints) -> Floats:
    """Return the lengths of edges given by their ends (…, 2), in space or in the plane."""
    return np.asarray(np.linalg.norm(points[ends[..., 1]] - points[ends[..., 0]], axis=-1))


def cross(u: Floats, v: Floats) -> Floats:
    """Return the cross product of vectors (…, 2) in the plane, (…,)."""
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def skew(vectors: Floats) -> Floats:
    """Return the matrices, (…, 3, 3), of x ↦ a × x for vectors a, (…, 3)."""
    matrix: Floats = np.zeros((*vectors.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., k, j], matrix[..., j, k] = vectors[..., i], -vectors[..., i]
    return matrix


def normals(points: Floats, triangles: Ints) -> Floats:
    """Return the normal of each triangle, as long as twice its area, (t, 3)."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return np.cross(b - a, c - a)


def surface_areas(points: Floats, triangles: Ints) -> Floats:
    """Return the area of each triangle in space, (t,)."""
    return np.asarray(np.linalg.norm(normals(points, triangles), axis=1) / 2)


def flat_areas(corners: Floats) -> Floats:
    """Return the areas (t,) of triangles (t, 3, 2) in the plane, negative where clockwise."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return 0.5 * cross(b - a, c - a)


def shapes(points: Floats, triangles: Ints) -> Floats:
    """Return height over longest edge of each triangle, (t,): 0.87 if equilateral, 0 if flat."""
    corners = points[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    double = np.linalg.norm(normals(points, triangles), axis=1)
    return double / np.maximum(longest, np.finfo(float).tiny) ** 2


def corner_angles(points: Floats, triangles: Ints) -> Floats:
    """Return the angle at each corner in rad, (t, 3), in space or in the plane."""
    corners = points[triangles]
    u, v = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    flat = points.shape[1] == 2
    sine = np.abs(cross(u, v)) if flat else np.linalg.norm(np.cross(u, v), axis=2)
    return np.asarray(np.arctan2(sine, np.einsum("tij,tij->ti", u, v)), dtype=np.float64)


def least_angles(corners: Floats) -> Floats:
    """Return the smallest angle of flat triangles (t, 3, 2) in rad, (t,); negative if clockwise."""
    u, v = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    return np.asarray(np.arctan2(cross(u, v), np.einsum("tij,tij->ti", u, v)).min(axis=1))


def angle_defects(triangles: Ints, edges: Edges, angles: Floats) -> Floats:
    """Return 2π minus the angles around each inner vertex, (n,), in rad; 0 at border vertices."""
    count = int(triangles.max()) + 1
    around = np.bincount(triangles.ravel(), angles.ravel(), minlength=count)
    defect: Floats = 2 * np.pi - around.astype(np.float64)
    defect[edges.ends[edges.border]] = 0
    return defect


def dihedral_angles(points: Floats, triangles: Ints, edges: Edges) -> Floats:
    """Return the angle between the normals at each edge, (e,), in rad; 0 at borders."""
    one, two = np.moveaxis(normals(points, triangles)[edges.sides], 1, 0)
    sine = np.linalg.norm(np.cross(one, two), axis=1)
    angle = np.arctan2(sine, np.einsum("ij,ij->i", one, two))
    return np.where(edges.count == 2, angle, 0.0)


def chart_turns(corners: Floats, edges: Edges) -> Floats:
    """Return the angle by which a direction turns across each edge, (e,), in rad, (−π, π].

    It is that of the edge in the chart of its second triangle, given by corners (t, 3, 2), minus
    that in the first's; 0 at borders, and exactly 0 inside a panel.
    """
    along = (np.roll(corners, -1, axis=1) - corners).reshape(-1, 2)
    angle: Floats = np.zeros(len(edges.ends))
    one, two = edges.twins[edges.inner].T
    a, b = along[one], -along[two]
    turn = np.arctan2(cross(a, b), np.einsum("ij,ij->i", a, b))
    # Edges inside a panel and seams without a turn shall not add rounding.
    angle[edges.inner] = np.where(np.abs(turn) < 1e-12, 0.0, turn)
    return angle


# ------------------------------------------------------------------------------ shape functions


def barycentric(corners: Floats, points: Floats) -> Floats:
    """Return barycentric coordinates (…, k, 3) of points (…, k, 2) in triangles (…, 3, 2)."""
    a, b, c = np.moveaxis(corners, -2, 0)
    u, v, w = b - a, c - a, points - a[..., None, :]
    area = cross(u, v)[..., None]
    second, third = cross(w, v[..., None, :]) / area, cross(u[..., None, :], w) / area
    return np.stack([1 - second - third, second, third], axis=-1)


def gradients(corners: Floats) -> Floats:
    """Return the gradients of the three shape functions in 1/m, (…, 3, 2), of (…, 3, 2) corners."""
    along = np.roll(corners, -2, axis=-2) - np.roll(corners, -1, axis=-2)
    double = cross(along[..., 0, :], along[..., 1, :])
    return np.stack([-along[..., 1], along[..., 0]], axis=-1) / double[..., None, None]


def laplacian(corners: Floats, triangles: Ints) -> csr_array:
    """Return the stiffness (n, n) of linear elements, ∫ ∇u·∇v, on flat triangles (t, 3, 2)."""
    opposite = np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)  # turned gradients · 2 Ā
    entries = np.einsum("tik,tjk->tij", opposite, opposite)
    entries /= 4 * flat_areas(corners)[:, None, None]
    rows, columns = np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, (1, 3)).ravel()
    count = int(triangles.max()) + 1
    return csr_array(coo_array((entries.ravel(), (rows, columns)), shape=(count, count)))


def spd_factor(matrix: sparray) -> SuperLU:
    """Factorise a symmetric or Hermitian positive definite matrix, without pivoting."""
    return splu(
        csc_array(matrix),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def harmonic_extension(matrix: csr_array, fixed: Bools) -> Callable[[Floats], Floats]:
    """Return a function that makes values (n,) harmonic, but at fixed vertices.

    The matrix is that of `Pattern.flat_laplacian`.
    """
    free = ~fixed
    if not free.any():
        return lambda values: values
    rows = matrix[free]
    inner, border = splu(rows[:, free].tocsc()), rows[:, fixed]

    def extend(values: Floats) -> Floats:
        out = values.copy()
        out[free] = -inner.solve(border @ values[fixed])
        return out

    return extend


# -------------------------------------------------------------------------- number of triangles


def equilateral_edge(area: float) -> float:
    """Return the edge length in m of an equilateral triangle, for its area in m²."""
    return float(np.sqrt(area / EQUILATERAL))


def expected_triangles(area: float, edge_length: float) -> float:
    """Return the number of equilateral triangles on an area in m², for an edge length in m."""
    return float(area / (EQUILATERAL * edge_length**2))


def require_affordable(area: float, edge_length: float, key: str | None = None) -> None:
    """Raise a MeshSizeError if a mesh of an area in m² will have more triangles than the limit."""
    most, count = _most.get(), expected_triangles(area, edge_length)
    if most is not None and count > most:
        longest = equilateral_edge(area / most)
        name = key or "edge_length"
        raise MeshSizeError(
            f"{name} = {edge_length:.3g} m gives about {count:.2g} triangles on {area:.3g} m², "
            f"more than {most}. Give at least {longest:.2g} m, {ALLOW}",
            area,
            key,
        )


def require_fewer(
    count: int,
    area: float,
    remedy: str = "Make fewer copies or longer edges",
    key: str | None = None,
) -> None:
    """Raise a MeshSizeError if a mesh on an area in m² has more triangles than the limit."""
    most = _most.get()
    if most is not None and count > most:
        raise MeshSizeError(
            f"{count:.3g} triangles are more than {most}. {remedy}, {ALLOW}", area, key
        )


@contextmanager
def triangle_limit(most: int | None) -> Iterator[None]:
    """Make meshes inside a `with` block with another largest number of triangles; None for none."""
    if most is not None:
        require_count(1, most=most)
    token = _most.set(most)
    try:
        yield
    finally:
        _most.reset(token)


def lowered_limit(most: int) -> AbstractContextManager[None]:
    """Make meshes inside a `with` block with a largest number of triangles, if none is lower."""
    now = _most.get()
    return triangle_limit(most if now is None else min(most, now))
