"""What lines are to be laid: families in each triangle, settings, and the triangles sewn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csc_array, csr_array, diags_array

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Area, Fraction, In, Length, Table, key
from toros_fem.base.validation import Bools, Floats, Ints, checked_floats, require_kind
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

Spread = Annotated[float, In(at_least=1, at_most=10)]
Complexes = npt.NDArray[np.complex128]
# Real or complex values.
Values = npt.NDArray[Any]
# Least weight of an edge: that between two right-angled triangles is 0.
LEAST_WEIGHT = 0.05


@dataclass(frozen=True, eq=False)
class LineField:
    """Families of fine parallel lines on a pattern, by triangle; the same on all ranks.

    Attributes:
        pattern: The pattern, with t triangles.
        shares: Part of the area that each of K families covers, shape (t, K), at least 0.
        angles: Direction of each family in rad, from the first axis of the triangle's panel
            chart, counter-clockwise, modulo π, shape (t, K).

    Raises:
        ParameterError: A shape is wrong, a value is not finite, or a share is negative.
    """

    pattern: Pattern
    shares: Floats
    angles: Floats

    def __post_init__(self) -> None:
        require_kind("pattern", self.pattern, Pattern, "a Pattern")
        count = len(self.pattern.panel)
        places = f"({count}, K), a value for each triangle and each of K ≥ 1 families"
        what = f"finite and of shape {places}"

        def fits(shape: tuple[int, ...]) -> bool:
            return len(shape) == 2 and shape[0] == count and shape[1] > 0

        for name in ("shares", "angles"):
            array = checked_floats(name, getattr(self, name), what, fits).copy()
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.shares.shape != self.angles.shape or self.shares.min() < 0:
            raise ParameterError(
                f"shares has {self.shares.shape[1]} families, of {self.shares.min():g} at least, "
                f"and angles {self.angles.shape[1]}; the numbers must be the same, and shares at "
                "least 0."
            )

    @property
    def families(self) -> int:
        """Number K of families."""
        return int(self.shares.shape[1])


class LineOptions(Table):
    """What lines to lay.

    The spacing of lines is their width over their share. It follows the mean of the share over
    the distance `even`; the local width takes up the rest. The more even the spacing, the fewer
    lines begin and end.

    Raises:
        ParameterError: A value is out of its bounds.
    """

    widths: tuple[Length, ...] = key(
        (0.9e-3,), "width of the lines: one for all families, or one for each"
    )
    print_width: Length = key(0.6e-3, "least width of a line, and of a gap between two")
    least_share: Fraction = key(0.03, "where a family has less than this share it has no lines")
    even: Length | None = key(
        10e-3,
        "distance over which spacings and directions are averaged; none takes one triangle only",
    )
    hole_area: Area = key(0.5e-6, "area of the smallest hole that stays open, and of a piece")
    spread: Spread = key(
        1.5,
        "largest local width over the width asked, and that over the smallest local one, which is "
        "never under print_width",
    )
    spacings: tuple[Length | None, ...] = key(
        (),
        "mean distance from line to line of each family, whose width then follows from its share; "
        "none for one whose spacing follows, none at all for all",
    )

    def __post_init__(self) -> None:
        if not self.widths:
            raise self.described()["widths"].refusal((), "must hold at least one width")
        for number, width in enumerate(self.widths):
            if width < self.print_width:
                raise ParameterError(
                    f"widths[{number}] = {width} m is under print_width = {self.print_width} m, "
                    "the least that can be printed. Ask for wider lines."
                )

    def width_of(self, family: int, families: int, share: float | None = None) -> float:
        """Return the width in m that is asked of a family.

        Args:
            share: Its mean share, from which the width of lines at a given spacing follows; None
                takes that of `widths`.

        Raises:
            ParameterError: There is neither one width for all nor one for each family, or the
                number of spacings is another one.
        """
        if len(self.spacings) not in (0, families):
            raise ParameterError(
                f"spacings holds {len(self.spacings)} distances for {families} families; it must "
                "hold one for each, or none."
            )
        spacing = self.spacings[family] if self.spacings else None
        if spacing is not None and share is not None:
            return max(share * spacing, self.print_width)
        if len(self.widths) not in (1, families):
            raise ParameterError(
                f"widths holds {len(self.widths)} widths for {families} families; it must hold "
                "one for all, or one for each."
            )
        return self.widths[family if len(self.widths) > 1 else 0]


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
