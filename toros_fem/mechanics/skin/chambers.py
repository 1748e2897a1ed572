"""Pressure chambers: their triangles, and the walls between them inside the skin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    NAMES,
    Bools,
    Floats,
    Ints,
    checked_list,
    checked_names,
    require_kind,
    whole_numbers,
)
from toros_fem.mechanics.skin.supports import Planes
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import between, half_edges, skew

if TYPE_CHECKING:
    from toros_fem.meshes.transfer import OtherMesh


@dataclass(frozen=True, eq=False)
class Chambers:
    """Parts of a skin with separate pressures.

    Two chambers with a common border are separated by a weightless wall inside the skin: the fan of
    the border about its mean. So every chamber is a closed body.

    Attributes:
        names: Names of the chambers, in the order of the pressures.
        of_cell: Chamber of each pattern triangle, (t,), numbered from 0; none is without a
            triangle.
    """

    names: tuple[str, ...]
    of_cell: Ints

    def __post_init__(self) -> None:
        names = checked_names("names", self.names, least=1)
        of_cell = whole_numbers("of_cell", self.of_cell, "one chamber for each triangle").copy()
        of_cell.setflags(write=False)
        last = len(names) - 1
        if of_cell.ndim != 1 or not np.array_equal(np.unique(of_cell), np.arange(last + 1)):
            found = np.unique(of_cell)
            listed = ", ".join(map(str, found[:6])) + (", …" if len(found) > 6 else "")
            raise ParameterError(
                f"of_cell contains the chambers {listed}; it must have one number for each "
                f"triangle, and each of 0 to {last} at least once."
            )
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "of_cell", of_cell)

    @property
    def count(self) -> int:
        """Number of chambers."""
        return len(self.names)

    def refined(self, finer: OtherMesh) -> Chambers:
        """Return the chambers of a refined pattern."""
        return Chambers(self.names, self.of_cell[finer.cell])


def chambers_of_panels(pattern: Pattern, panels: Mapping[str, Sequence[str]]) -> Chambers:
    """Return chambers made of whole panels, by the names of each; every panel belongs to one.

    Raises:
        PanelError: A panel of that name does not exist.
    """
    require_kind("panels", panels, Mapping, "a mapping from chambers to lists of panels")
    of_panel, times = np.zeros((2, len(pattern.panel_names)), dtype=np.int64)
    for chamber, members in enumerate(panels.values()):
        checked_list(f"panels of chamber {chamber}", members, str, NAMES)
        for name in members:
            of_panel[pattern.panel_index(name)] = chamber
            times[pattern.panel_index(name)] += 1
    if (times != 1).any():
        k = int(np.argmax(times != 1))
        raise ParameterError(
            f"panel {pattern.panel_names[k]!r} is given {times[k]} times; it bounds one chamber."
        )
    return Chambers(tuple(panels), of_panel[pattern.panel])


@dataclass(frozen=True, eq=False)
class Fan:
    """Fan of edges about an apex c: a wall inside the skin, or one that a symmetry plane cut off.

    The volume of its cone from the origin is v = Σ c·(xᵢ × xⱼ)/6 over the edges from i to j, by the
    sum in eq. (7). c is fixed, as the foot of the origin in the plane of a lid, or a mean of the
    vertices. Where the edges end in planes through the origin, so does the fan. Arguments x are
    the positions of the vertices from `Planes.origin`, (m, 3), in m.

    Attributes:
        vertices: Assembled vertices, (m,).
        edges: Ends i, j of the edges among them, as the triangles of the first side run, (k, 2).
        sides: The two chambers, −1 for the outside.
        foot: Part of c that is fixed, (3,), in m.
        weights: Weight of each vertex in c, (m,).
        kept: 1 for the components of c that vertices have part in, 0 across the symmetry planes
            that c lies in, (3,).
    """

    vertices: Ints
    edges: Ints
    sides: tuple[int, int]
    foot: Floats
    weights: Floats
    kept: Floats

    @property
    def linked(self) -> Bools:
        """Whether two vertices have an entry in the second derivative, (m, m)."""
        joined = self._joined > 0
        bears = self.weights != 0
        return np.asarray(joined | joined.T | bears | bears[:, None])

    def volume(self, x: Floats) -> float:
        """Return v in m³."""
        return float(self._apex(x) @ self._turn(x)) / 6

    def gradient(self, x: Floats) -> Floats:
        """Return dv/dx, (m, 3), in m²."""
        by_apex = np.outer(self.weights, self.kept * self._turn(x))
        return np.asarray((by_apex + np.cross(self._step(x), self._apex(x))) / 6)

    def hessian(self, x: Floats, rows: Ints, columns: Ints) -> Floats:
        """Return entries of d²v/dx² in m, each at a row and a column 3 i + component."""
        (i, a), (j, b) = np.divmod(rows, 3), np.divmod(columns, 3)
        by_step, by_apex = -skew(self._step(x)), -skew(self._apex(x))
        borne = self.weights[i] * self.kept[a] * by_step[j, a, b]
        borne += self.weights[j] * self.kept[b] * by_step[i, b, a]
        joined = self._joined[i, j] - self._joined[j, i]
        return np.asarray((borne + joined * by_apex[a, b]) / 6)

    @property
    def _joined(self) -> Floats:
        """1 where an edge runs from one vertex to another, (m, m)."""
        joined = np.zeros((len(self.vertices), len(self.vertices)))
        joined[self.edges[:, 0], self.edges[:, 1]] = 1
        return joined

    def _apex(self, x: Floats) -> Floats:
        return np.asarray(self.foot + self.kept * (self.weights @ x))

    def _turn(self, x: Floats) -> Floats:
        """Σ xᵢ × xⱼ."""
        return np.cross(x[self.edges[:, 0]], x[self.edges[:, 1]]).sum(axis=0)

    def _step(self, x: Floats) -> Floats:
        """Of each vertex the ends of edges from it, less the starts of those to it, (m, 3)."""
        step = np.zeros_like(x)
        np.add.at(step, self.edges[:, 0], x[self.edges[:, 1]])
        np.subtract.at(step, self.edges[:, 1], x[self.edges[:, 0]])
        return step


def find_lids(pattern: Pattern, chambers: Chambers | None, planes: Planes) -> list[Fan]:
    """Return the lids of all chambers: about the foot of the origin in planes, or a rim's mean."""
    lids = _rim_lids(pattern, chambers, planes)
    for axis, at, border in planes.lids():
        ends = half_edges(pattern.triangles)[border]
        owner = 0 * border if chambers is None else chambers.of_cell[border // 3]
        foot = np.where(np.arange(3) == axis, at - planes.origin[axis], 0.0)
        for chamber in np.unique(owner):
            vertices, edges = np.unique(ends[owner == chamber], return_inverse=True)
            unweighted, sides = np.zeros(len(vertices)), (int(chamber), -1)
            lids.append(Fan(vertices, edges.reshape(-1, 2), sides, foot, unweighted, np.zeros(3)))
    return lids


def _rim_lids(pattern: Pattern, chambers: Chambers | None, planes: Planes) -> list[Fan]:
    border = planes.rims()
    begins, ends = half_edges(pattern.triangles)[border].T
    of_edge = 0 * border if chambers is None else chambers.of_cell[border // 3]
    owner = dict(zip(map(int, begins), map(int, of_edge), strict=True))
    following = {int(a): [int(b)] for a, b in zip(begins, ends, strict=True)}
    stops = np.zeros(len(pattern.points), dtype=bool)
    stops[np.setxor1d(begins, ends)] = True
    in_plane = planes.through_origin()
    lids = []
    for path in _paths(following, stops):
        met = sorted({owner[vertex] for vertex in path if vertex in owner})
        if len(met) > 1:
            assert chambers is not None
            raise ParameterError(
                f"one rim borders the chambers {' and '.join(chambers.names[k] for k in met)}: "
                "what closes each is not unique. Let a rim belong to one chamber, or add a cap."
            )
        sides = met[0], -1
        if path[0] == path[-1]:
            lids.append(_closed_wall(path, sides))
        else:
            lids.append(_cut_wall(path, sides, in_plane[[path[0], path[-1]]]))
    return lids


def find_walls(pattern: Pattern, chambers: Chambers, planes: Planes) -> list[Fan]:
    """Return the walls between chambers, about the means of their borders.

    A border that ends where three chambers meet is closed by the chord to its other end, the line
    where three walls meet. A ParameterError is raised where a border ends at a free edge outside
    all symmetry planes, or where too many chambers meet, so that the chords leave one open.
    """
    if chambers.of_cell.shape != (len(pattern.triangles),):
        raise ParameterError(
            f"chambers.of_cell has shape {chambers.of_cell.shape}; this pattern has "
            f"{len(pattern.triangles)} triangles. Make the chambers from its own pattern."
        )
    edges, sides = _borders(pattern, chambers)
    at_border = np.zeros(len(pattern.points), dtype=bool)
    at_border[pattern.free_edges] = True
    stops = at_border | (np.bincount(edges.ravel(), minlength=len(at_border)) != 2)
    in_plane = planes.through_origin()
    walls, chords = [], []
    for pair in np.unique(sides, axis=0):
        one, two = map(int, pair)
        following: dict[int, list[int]] = {}
        for a, b in edges[(sides == pair).all(axis=1)].tolist():
            following.setdefault(a, []).append(b)
        for path in _paths(following, stops):
            cut = [end for end in (path[0], path[-1]) if at_border[end]]
            if cut:
                walls.append(_cut_wall(path, (one, two), in_plane[cut]))
            else:
                walls.append(_closed_wall(path, (one, two)))
                chords.append((one, two, path[0], path[-1]))
    _require_bodies(chords, chambers)
    return walls


def _borders(pattern: Pattern, chambers: Chambers) -> tuple[Ints, Ints]:
    """Return the directed edges (k, 2) between chambers, as in the lower one, and both chambers."""
    edges = pattern.edges
    twins = edges.twins[between(edges, chambers.of_cell)]
    sides = chambers.of_cell[twins // 3]
    half = np.where(sides[:, 0] < sides[:, 1], twins[:, 0], twins[:, 1])
    order = np.argsort(half)
    return half_edges(pattern.triangles)[half[order]], np.sort(sides[order], axis=1)


def _paths(following: dict[int, list[int]], stops: Bools) -> list[list[int]]:
    """Join directed edges to paths from stop to stop, and then to loops without a stop."""
    starts = sorted(following)
    paths = []
    for start in sorted(starts, key=lambda a: not stops[a]):
        while following[start]:
            path = [start, following[start].pop()]
            while path[-1] != start and not stops[path[-1]]:
                path.append(following[path[-1]].pop())
            paths.append(path)
    return paths


def _closed_wall(path: list[int], sides: tuple[int, int]) -> Fan:
    """Return the fan of a loop, or of a path that its chord closes."""
    vertices = np.array(path[:-1] if path[0] == path[-1] else path)
    count = len(vertices)
    edges = np.stack([np.arange(count), np.roll(np.arange(count), -1)], axis=1)
    return Fan(vertices, edges, sides, np.zeros(3), np.full(count, 1 / count), np.ones(3))


def _cut_wall(path: list[int], sides: tuple[int, int], in_plane: Bools) -> Fan:
    """Return the fan of a path whose ends lie in symmetry planes; `in_plane` is of those cut."""
    if len(in_plane) == 1 or not in_plane.any(axis=1).all():
        raise ParameterError(
            f"the border between chambers {sides[0]} and {sides[1]} runs from vertex {path[0]} to "
            f"{path[-1]}: it must be a loop, or have both ends fixed in symmetry planes, or join "
            "other borders at both; of two planes across one axis, only that nearer to the origin "
            "may cut it. Move the chambers' borders, or simulate the whole skin."
        )
    weights: Floats = np.ones(len(path))  # a mirrored whole has the inner ones twice as often
    weights[[0, -1]] = 0.5
    weights /= weights.sum()
    kept = np.where(in_plane.any(axis=0), 0.0, 1.0)
    edges = np.stack([np.arange(len(path) - 1), np.arange(1, len(path))], axis=1)
    return Fan(np.array(path), edges, sides, np.zeros(3), weights, kept)


def _require_bodies(chords: list[tuple[int, int, int, int]], chambers: Chambers) -> None:
    """Check that the chords of each chamber's walls cancel; each has two sides and two ends."""
    count: dict[tuple[int, int, int], int] = {}
    for one, two, a, b in chords:
        for side, sign in ((one, 1), (two, -1)):
            key = (side, min(a, b), max(a, b))
            count[key] = count.get(key, 0) + sign * int(np.sign(b - a))
    for (side, a, b), left in count.items():
        if left:
            raise ParameterError(
                f"chamber {chambers.names[side]!r} meets others at three points or more, among "
                f"them vertices {a} and {b}: the walls there are not unique. Let at most two "
                "points be common to three chambers."
            )
