"""The triangles that lines are laid on, sewn: values and directions at their vertices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csc_array, diags_array

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


def coordinates(places: Complexes) -> Floats:
    """Return complex numbers (…) as points or vectors (…, 2)."""
    return np.stack([places.real, places.imag], axis=-1)


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
        return int(self.vertex.max()) + 1

    @cached_property
    def areas(self) -> Floats:
        """Area of each triangle in m²."""
        return flat_areas(self.corners)

    @cached_property
    def vertex_areas(self) -> Floats:
        """A third of the area around each vertex in m²."""
        return np.bincount(self.vertex.ravel(), np.repeat(self.areas / 3, 3), self.size)

    @cached_property
    def weights(self) -> Floats:
        """Weight of each edge in a Laplacian, (e,): half the cotangents of the opposite angles."""
        flat = self.corners.reshape(-1, 2)
        angle = corner_angles(flat, np.arange(len(flat)).reshape(-1, 3))
        opposite = np.roll(1 / np.tan(angle), 1, axis=1) / 2  # edge c … c + 1: corner c + 2
        weight = np.bincount(self.edges.of_triangle.ravel(), opposite.ravel())
        return np.maximum(weight, LEAST_WEIGHT)

    @cached_property
    def turn_along(self) -> Floats:
        """Angle that is added to a direction from an edge's first end to its second, (e,)."""
        half = self.edges.twins[:, 0]
        turn, vertex = self.turn.ravel(), self.vertex.ravel()
        change = turn[half] - turn[following(half)]
        return np.where(vertex[half] == self.edges.ends[:, 0], change, -change)

    def at_vertices(self, values: Floats) -> Floats:
        """Return means of values of the triangles, (t,), by area."""
        share = np.repeat(values * self.areas / 3, 3)
        return np.bincount(self.vertex.ravel(), share, self.size) / self.vertex_areas

    def double_angles(self, angles: Floats, weights: Floats) -> Complexes:
        """Return mean double-angle vectors at vertices, (n,), of directions in triangles, (t,)."""
        value = (self.areas * weights / 3)[:, None] * np.exp(2j * (angles[:, None] - self.turn))
        sums = (
            np.bincount(self.vertex.ravel(), part.ravel(), self.size)
            for part in (value.real, value.imag)
        )
        return in_plane(np.stack(list(sums), axis=1)) / self.vertex_areas

    def around(self, values: Floats) -> Floats:
        """Return the sum of values of edges, (e,), around each vertex, (n,)."""
        i, j = self.edges.ends.T
        return np.bincount(i, values, self.size) + np.bincount(j, values, self.size)

    def laplacian(self, weights: Floats, factors: Values | float = 1.0) -> csc_array:
        """Return the matrix of Σ w |z_j − f z_i|² over edges from i to j, with |f| = 1, (n, n)."""
        i, j = self.edges.ends.T
        pull = coo_array((weights * factors, (j, i)), shape=(self.size, self.size))
        return csc_array(diags_array(self.around(weights)) - (pull + pull.conj().T))

    def smoother(
        self, distance: float | None, *, turned: bool = False
    ) -> Callable[[Values], Values]:
        """Return what averages values at vertices, (n,), over a distance, as by a Gaussian.

        Two implicit steps of diffusion take half the time each.

        Args:
            distance: Standard deviation in m; None leaves values as they are.
            turned: Whether the values are double-angle vectors, each in the chart of the vertex's
                first corner.
        """
        if distance is None:
            return lambda values: values
        area, factors = self.vertex_areas, np.exp(2j * self.turn_along) if turned else 1.0
        diffusion = distance**2 / 4 * self.laplacian(self.weights, factors)
        factor = spd_factor(diags_array(area) + diffusion)
        return lambda values: factor.solve(area * factor.solve(area * values))


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
