"""Directions at the vertices of a sewn skin: how they turn from chart to chart, and their mean."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import (
    Edges,
    chart_turns,
    corner_angles,
    edges_of,
    fans,
    flat_areas,
    following,
)

Complexes = npt.NDArray[np.complex128]

# Least weight of an edge: that between two right-angled triangles is 0.
LEAST_WEIGHT = 0.05


@dataclass(frozen=True, eq=False)
class LineMesh:
    """The triangles of a pattern that may carry lines, sewn, with the angles between their charts.

    A direction at a vertex is an angle in one of the charts around it, that of its first corner.
    In the chart of another corner it is larger by `turn`.

    Attributes:
        pattern: The pattern.
        cells: Its triangles that may carry lines, (t,), in ascending order.
        corners: Their flat corners, (t, 3, 2), in m.
        vertex: Vertex at each corner, (t, 3). Fans that only share a point have one each.
        edges: Edges between these vertices.
        turn: Angle in rad that is added to a direction at the corner's vertex, (t, 3).
    """

    pattern: Pattern
    cells: Ints
    corners: Floats
    vertex: Ints
    edges: Edges
    turn: Floats

    @property
    def size(self) -> int:
        """Number of vertices."""
        return int(self.vertex.max()) + 1

    @cached_property
    def areas(self) -> Floats:
        """Area of each triangle in m²."""
        return flat_areas(self.corners)

    @cached_property
    def vertex_areas(self) -> Floats:
        """A third of the area around each vertex in m²."""
        third = np.repeat(self.areas / 3, 3)
        return np.bincount(self.vertex.ravel(), third, minlength=self.size).astype(np.float64)

    @cached_property
    def weights(self) -> Floats:
        """Weight of each edge in a Laplacian, (e,): half the cotangents of the opposite angles."""
        flat = self.corners.reshape(-1, 2)
        angle = corner_angles(flat, np.arange(len(flat)).reshape(-1, 3))
        opposite = np.roll(1 / np.tan(angle), 1, axis=1) / 2  # edge c … c + 1: corner c + 2
        count = len(self.edges.ends)
        weight = np.bincount(self.edges.of_triangle.ravel(), opposite.ravel(), minlength=count)
        return np.maximum(weight, LEAST_WEIGHT)

    def at_vertices(self, values: Floats) -> Floats:
        """Return means of values of the triangles, (t,), by area."""
        share = np.repeat(values * self.areas / 3, 3)
        return np.bincount(self.vertex.ravel(), share, minlength=self.size) / self.vertex_areas

    def around(self, values: Floats) -> Floats:
        """Return the sum of values of edges, (e,), around each vertex, (n,)."""
        i, j = self.edges.ends.T
        total = np.bincount(i, values, self.size) + np.bincount(j, values, self.size)
        return np.asarray(total, dtype=np.float64)

    @property
    def laplacian(self) -> csc_array:
        """The Laplacian of values at vertices, (n, n), positive semidefinite."""
        i, j = self.edges.ends.T
        pull = _symmetric(i, j, self.weights, self.size)
        return csc_array(diags_array(self.around(self.weights)) - pull)

    def smooth(self, values: Floats, distance: float | None) -> Floats:
        """Return values at vertices, (n,), averaged over a distance in m, as by a Gaussian."""
        if distance is None:
            return values
        i, j = self.edges.ends.T
        pull = _symmetric(i, j, self.weights, self.size)
        return np.asarray(self._diffused(pull.tocsc(), values, distance).real)

    def smooth_directions(self, double: Complexes, distance: float | None) -> Complexes:
        """Return double-angle vectors at vertices averaged over a distance in m.

        Args:
            double: exp(2 i angle) times a weight, (n,), each in the chart of the first corner.
            distance: Standard deviation of the Gaussian.
        """
        if distance is None:
            return double
        i, j = self.edges.ends.T
        pull = _symmetric(i, j, self.weights * np.exp(-2j * self.edge_turn), self.size)
        return np.asarray(self._diffused(pull.tocsc(), double, distance))

    def double_angles(self, angles: Floats, weights: Floats) -> Complexes:
        """Return mean double-angle vectors at vertices, (n,), of directions in triangles, (t,)."""
        value = (self.areas * weights / 3)[:, None] * np.exp(2j * (angles[:, None] - self.turn))
        at, count = self.vertex.ravel(), self.size
        real = np.bincount(at, value.real.ravel(), minlength=count)
        imaginary = np.bincount(at, value.imag.ravel(), minlength=count)
        return np.asarray((real + 1j * imaginary) / self.vertex_areas, dtype=np.complex128)

    def barycentric(self, cell: Ints, points: Floats) -> Floats:
        """Return barycentric coordinates of flat points, (k, 2), in triangles, (k, 3)."""
        a, b, c = np.moveaxis(self.corners[cell], 1, 0)
        u, v, w = b - a, c - a, points - a
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        second = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / area
        third = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / area
        return np.stack([1 - second - third, second, third], axis=1)

    @cached_property
    def edge_turn(self) -> Floats:
        """Angle that is added to a direction from an edge's first end to its second, (e,)."""
        half = self.edges.twins[:, 0]
        turn, vertex = self.turn.ravel(), self.vertex.ravel()
        change = turn[half] - turn[following(half)]
        return np.where(vertex[half] == self.edges.ends[:, 0], change, -change)

    def _diffused(self, pull: csc_array, values: npt.NDArray, distance: float) -> npt.NDArray:
        """Two implicit steps of diffusion for half the time each."""
        time = distance**2 / 4
        matrix = diags_array(self.vertex_areas + time * self.around(self.weights)) - time * pull
        factor = splu(
            csc_array(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        for _ in range(2):
            values = factor.solve(self.vertex_areas * values)
        return values


def make_line_mesh(pattern: Pattern, active: Bools) -> LineMesh:
    """Return the mesh that lines are laid on.

    Args:
        pattern: Any pattern.
        active: Whether each of its triangles may carry lines, (t,); at least one does.
    """
    cells = np.flatnonzero(active)
    whole = edges_of(pattern.triangles[cells])
    vertex = fans(pattern.triangles[cells], whole, whole.inner)
    edges = edges_of(vertex)
    corners = pattern.corners[cells]
    return LineMesh(pattern, cells, corners, vertex, edges, _turns(corners, vertex, edges))


def _turns(corners: Floats, vertex: Ints, edges: Edges) -> Floats:
    """Return the angles from the chart of each vertex's first corner to those of all its corners.

    They are added up from triangle to triangle around the vertex, both ways from the first corner.
    """
    turn = np.zeros(vertex.shape)
    angle = chart_turns(corners, edges)
    turned = np.unique(edges.ends[angle != 0])
    if not len(turned):
        return turn
    # Corners are numbered as the half-edges they begin: edge by edge to the next in the fan.
    one, two = edges.twins[edges.inner].T
    step = angle[edges.inner]
    begin = np.concatenate([one, following(one), following(two), two])
    end = np.concatenate([following(two), two, one, following(one)])
    change = np.concatenate([step, step, -step, -step])
    near: dict[int, list[tuple[int, float]]] = {}
    for k in np.flatnonzero(np.isin(vertex.ravel()[begin], turned)):
        near.setdefault(int(begin[k]), []).append((int(end[k]), float(change[k])))
    flat = turn.ravel()
    first: dict[int, int] = {}
    for corner in np.flatnonzero(np.isin(vertex.ravel(), turned)):
        first.setdefault(int(vertex.ravel()[corner]), int(corner))
    for start in first.values():
        seen, front = {start}, [start]
        while front:
            following_front = []
            for corner in front:
                for other, step_angle in near.get(corner, ()):
                    if other not in seen:
                        seen.add(other)
                        flat[other] = flat[corner] + step_angle
                        following_front.append(other)
            front = following_front
    return flat.reshape(vertex.shape)


def _symmetric(i: Ints, j: Ints, values: npt.NDArray, size: int) -> coo_array:
    """Return the Hermitian matrix with values at (i, j), whose conjugates are at (j, i)."""
    place = np.concatenate([i, j]), np.concatenate([j, i])
    return coo_array((np.concatenate([values, np.conj(values)]), place), shape=(size, size))
