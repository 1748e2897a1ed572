"""The triangles that lines are laid on, sewn: values and directions at their vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csc_array, csr_array, diags_array

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import (
    Edges,
    barycentric,
    chart_turns,
    corner_angles,
    edges_of,
    fans,
    flat_areas,
    following,
    spd_factor,
)

Complexes = npt.NDArray[np.complex128]
# Real or complex values.
Values = npt.NDArray[Any]

# Least weight of an edge: that between two right-angled triangles is 0.
LEAST_WEIGHT = 0.05


def in_plane(points: Floats) -> Complexes:
    """Return points or vectors (…, 2) as complex numbers (…)."""
    return np.asarray(points[..., 0] + 1j * points[..., 1])


def coordinates(places: Complexes | complex) -> Floats:
    """Return complex numbers (…) as points or vectors (…, 2)."""
    z = np.asarray(places)
    return np.stack([z.real, z.imag], axis=-1)


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
        edge_turns: Angle of the chart behind each edge to that before it, as of `chart_turns`.
        turn: Angle in rad that is added to a direction at the corner's vertex, (t, 3).
    """

    pattern: Pattern
    cells: Ints
    corners: Floats
    vertex: Ints
    edges: Edges
    edge_turns: Floats
    turn: Floats

    @cached_property
    def size(self) -> int:
        """Number of vertices."""
        return int(self.vertex.max(initial=-1)) + 1

    @cached_property
    def flat(self) -> Complexes:
        """The corners as complex numbers, (t, 3)."""
        return in_plane(self.corners)

    @cached_property
    def sides(self) -> Complexes:
        """The way from corner c to corner c + 1, (t, 3), in m."""
        return np.roll(self.flat, -1, axis=1) - self.flat

    @cached_property
    def areas(self) -> Floats:
        """Area of each triangle in m²."""
        return flat_areas(self.corners)

    @cached_property
    def vertex_areas(self) -> Floats:
        """A third of the area around each vertex in m²."""
        return np.asarray(self._sums(np.repeat(self.areas / 3, 3)))

    @cached_property
    def weights(self) -> Floats:
        """Weight of each edge in a Laplacian, (e,): half the cotangents of the opposite angles."""
        flat = self.corners.reshape(-1, 2)
        angle = corner_angles(flat, np.arange(len(flat)).reshape(-1, 3))
        opposite = np.roll(1 / np.tan(angle), 1, axis=1) / 2  # edge c … c + 1: corner c + 2
        weight = np.bincount(self.edges.of_triangle.ravel(), opposite.ravel())
        return np.maximum(weight, LEAST_WEIGHT)

    @cached_property
    def forward(self) -> Bools:
        """Whether side c … c + 1 of each triangle runs from its edge's first end, (t, 3)."""
        return self.vertex == self.edges.ends[self.edges.of_triangle, 0]

    @cached_property
    def border(self) -> Ints:
        """Half-edges of the pattern that `edges.border` are, (b,)."""
        half = self.edges.twins[self.edges.border, 0]
        return 3 * self.cells[half // 3] + half % 3

    @cached_property
    def edge_angles(self) -> Floats:
        """Angle in rad by which directions turn from each edge's first end to its second, (e,)."""
        half = self.edges.twins[:, 0]
        change = (self.turn - np.roll(self.turn, -1, axis=1)).ravel()[half]
        return np.where(self.forward.ravel()[half], change, -change)

    def barycentric(self, cell: Ints | int, place: Complexes | complex) -> Floats:
        """Return barycentric coordinates of places in triangles, (…, 3)."""
        return barycentric(self.corners[cell], coordinates(place)[..., None, :])[..., 0, :]

    def at_vertices(self, values: Floats) -> Floats:
        """Return means of values of the triangles, (t,), by area."""
        return np.asarray(self._sums(np.repeat(values * self.areas / 3, 3)) / self.vertex_areas)

    def double_angles(self, angles: Floats, weights: Floats) -> Complexes:
        """Return mean double-angle vectors at vertices, (n,), of directions in triangles, (t,)."""
        value = (self.areas * weights / 3)[:, None] * np.exp(2j * (angles[:, None] - self.turn))
        return np.asarray(self._sums(value.ravel()) / self.vertex_areas)

    def _sums(self, values: Values) -> Values:
        """Return the sum of values at the corners, (3 t,), around each vertex, (n,)."""
        corner = np.arange(self.vertex.size)
        shape = self.size, len(corner)
        return csr_array((np.ones(len(corner)), (self.vertex.ravel(), corner)), shape) @ values

    def around(self, values: Floats) -> Floats:
        """Return the sum of values of edges, (e,), around each vertex, (n,)."""
        i, j = self.edges.ends.T
        return np.add(*(np.bincount(end, values, self.size) for end in (i, j)), dtype=np.float64)

    def laplacian(self, weights: Floats, factors: Values | float = 1.0) -> csc_array:
        """Return the matrix of Σ w |z_j − f z_i|² over edges from i to j, with |f| = 1, (n, n)."""
        i, j = self.edges.ends.T
        pull = coo_array((weights * factors, (j, i)), shape=(self.size, self.size))
        return csc_array(diags_array(self.around(weights)) - (pull + pull.conj().T))

    def smoother(
        self, distance: float | None, *, turned: bool = False
    ) -> Callable[[Values], Values]:
        """Return what averages values at vertices, (n,), as by a Gaussian of a distance in m.

        Two implicit steps of diffusion take half the time each. No distance leaves values as they
        are. Double-angle vectors are `turned` from the chart of each vertex's first corner.
        """
        if distance is None:
            return lambda values: values
        area = self.vertex_areas
        factors = np.exp(2j * self.edge_angles) if turned else 1.0
        diffusion = distance**2 / 4 * self.laplacian(self.weights, factors)
        factor = spd_factor(diags_array(area) + diffusion)
        return lambda values: factor.solve(area * factor.solve(area * values))


def make_line_mesh(pattern: Pattern, active: Bools) -> LineMesh:
    """Return the mesh of the triangles that may carry lines, (t,)."""
    cells = np.flatnonzero(active)
    whole = edges_of(pattern.triangles[cells])
    vertex = fans(pattern.triangles[cells], whole, whole.inner)
    edges = edges_of(vertex)
    corners = pattern.corners[cells]
    turns = chart_turns(corners, edges)
    return LineMesh(pattern, cells, corners, vertex, edges, turns, _turns(vertex, edges, turns))


def _turns(vertex: Ints, edges: Edges, edge_turns: Floats) -> Floats:
    """Return the angles from the chart of each vertex's first corner to those of all its corners.

    They are added up from triangle to triangle around the vertex, both ways from the first corner.
    """
    # Corners are numbered as the half-edges they begin. Links that go around clockwise come last:
    # where both ways meet in one corner, theirs counts.
    one, two = edges.twins[edges.inner].T
    step = edge_turns[edges.inner]
    begin = np.concatenate([following(two), following(one), one, two])
    end = np.concatenate([one, two, following(two), following(one)])
    change = np.concatenate([-step, step, step, -step])
    turn = np.zeros(vertex.size)
    known = np.zeros(vertex.size, dtype=bool)
    known[np.unique(vertex, return_index=True)[1]] = True
    while len(new := np.flatnonzero(known[begin] & ~known[end])):
        turn[end[new]] = turn[begin[new]] + change[new]
        known[end[new]] = True
    return turn.reshape(vertex.shape)
