"""Pressure chambers: their triangles, and the walls between them inside the skin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_names, require_kind, require_names, whole_numbers
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.refine import Refinement
from toros_fem.meshes.topology import between, half_edges


@dataclass(frozen=True, eq=False)
class Chambers:
    """Parts of a skin with separate pressures.

    Two chambers with a common border are separated by a weightless wall inside the skin: the fan
    of the border about its mean. So every chamber is a closed body.

    Attributes:
        names: Names of the chambers, in the order of the pressures.
        of_cell: Chamber of each pattern triangle, shape (t,), numbered from 0.

    Raises:
        ParameterError: There is no chamber, or two have one name; `of_cell` contains other
            numbers, or leaves a chamber without a triangle.
    """

    names: tuple[str, ...]
    of_cell: Ints

    def __post_init__(self) -> None:
        names = checked_names("names", self.names)
        object.__setattr__(self, "names", names)
        of_cell = whole_numbers("of_cell", self.of_cell, "one chamber for each triangle").copy()
        of_cell.setflags(write=False)
        object.__setattr__(self, "of_cell", of_cell)
        if not names:
            raise ParameterError("names = () must name each chamber, and at least one.")
        last = len(self.names) - 1
        if of_cell.ndim != 1 or not np.array_equal(np.unique(of_cell), np.arange(last + 1)):
            raise ParameterError(
                f"of_cell contains the chambers {_listed(np.unique(of_cell))}; it must have one "
                f"number for each triangle, and each of 0 to {last} at least once."
            )

    @property
    def count(self) -> int:
        """Number of chambers."""
        return len(self.names)

    def refined(self, finer: Refinement) -> Chambers:
        """Return the chambers of a refined pattern."""
        return Chambers(self.names, self.of_cell[finer.cell])


def _listed(numbers: Ints) -> str:
    """Return the first numbers as text."""
    return ", ".join(str(number) for number in numbers[:6]) + (", …" if len(numbers) > 6 else "")


def chambers_of_panels(pattern: Pattern, panels: Mapping[str, Sequence[str]]) -> Chambers:
    """Return chambers made of whole panels.

    Args:
        pattern: The pattern.
        panels: Panels of each chamber, by its name; each panel belongs to one chamber.

    Raises:
        PanelError: A panel of that name does not exist.
        ParameterError: A panel belongs to no chamber, or to two.
    """
    require_kind("panels", panels, Mapping, "a mapping from chambers to lists of panels")
    of_panel = np.full(len(pattern.panel_names), -1)
    for chamber, members in enumerate(panels.values()):
        require_names(f"panels of chamber {chamber}", members)
        for name in members:
            index = pattern.panel_index(name)
            if of_panel[index] >= 0:
                raise ParameterError(f"panel {name!r} is given twice; it bounds one chamber only.")
            of_panel[index] = chamber
    if (of_panel < 0).any():
        name = pattern.panel_names[int(np.argmin(of_panel))]
        raise ParameterError(f"panel {name!r} belongs to no chamber; give it to one.")
    return Chambers(tuple(panels), of_panel[pattern.panel])


@dataclass(frozen=True, eq=False)
class Wall:
    """Wall between two chambers: the fan of their common border about its mean c.

    The volume v = Σ xᵢ·(xᵢ₊₁ × c)/6 = c·g/6 with g = Σ xᵢ × xᵢ₊₁ is that of the fan's cone from
    the origin, by the sum in eq. (7). Arguments x are the positions of its vertices from the
    origin of `Supports.closure`, (m, 3), in m.

    Attributes:
        vertices: Assembled vertices in order, as the triangles of the first side run, (m,).
        closed: Whether the last vertex is connected to the first; else both ends lie in planes
            through the origin, and the missing part does too.
        sides: The two chambers.
        weights: Weight of each vertex in c, (m,).
        kept: 1 for the components of c, 0 across the symmetry planes that c lies in, (3,).
    """

    vertices: Ints
    closed: bool
    sides: tuple[int, int]
    weights: Floats
    kept: Floats

    @property
    def linked(self) -> Bools:
        """Whether two vertices have an entry in the second derivative, (m, m): all have."""
        return np.ones((len(self.vertices), len(self.vertices)), dtype=bool)

    def volume(self, x: Floats) -> float:
        """Return v in m³."""
        return float(self._mean(x) @ self._turn(x)) / 6

    def gradient(self, x: Floats) -> Floats:
        """Return dv/dx, (m, 3), in m²."""
        by_mean = self.weights[:, None] * (self.kept * self._turn(x))
        return (by_mean + np.cross(self._step(x), self._mean(x))) / 6

    def hessian(self, x: Floats) -> Floats:
        """Return d²v/dx², (3 m, 3 m), in m."""
        count = len(x)
        mean = self.weights[:, None, None] * np.diag(self.kept)  # dc/dxⱼ, (m, 3, 3)
        turn = -_skew(self._step(x))  # dg/dxⱼ
        both = np.einsum("ika,jkb->iajb", mean, turn)
        next_one = np.roll(np.eye(count), 1, axis=1)
        if not self.closed:
            next_one[-1] = 0
        across = np.einsum("ij,ab->iajb", next_one, -_skew(self._mean(x)[None])[0])
        half = (both + across).reshape(3 * count, 3 * count)
        return np.asarray((half + half.T) / 6)

    def _mean(self, x: Floats) -> Floats:
        return np.asarray(self.kept * (self.weights @ x))

    def _turn(self, x: Floats) -> Floats:
        pairs = np.cross(x, np.roll(x, -1, axis=0))
        return np.asarray(pairs.sum(axis=0) if self.closed else pairs[:-1].sum(axis=0))

    def _step(self, x: Floats) -> Floats:
        """Differences xⱼ₊₁ − xⱼ₋₁; at the ends of an open border the missing vertex counts 0."""
        after, before = np.roll(x, -1, axis=0), np.roll(x, 1, axis=0)
        if not self.closed:
            after[-1] = before[0] = 0
        return np.asarray(after - before)


@dataclass(frozen=True, eq=False)
class Lid:
    """Wall that is missing in a symmetry plane without the origin: the fan of the border's edges.

    The edges from i to j, as the skin's triangles run, are joined to the foot a of the origin in
    the plane: v = Σ a·(xᵢ × xⱼ)/6. Where the border ends in planes through the origin, so does the
    fan. Arguments x are the positions of its vertices from the origin, (m, 3), in m.

    Attributes:
        vertices: Assembled vertices, (m,).
        edges: Ends i, j of the border's edges among them, (k, 2).
        apex: a, from the origin, (3,), in m.
        sides: The chamber, and −1 for the outside.
    """

    vertices: Ints
    edges: Ints
    apex: Floats
    sides: tuple[int, int]

    @property
    def linked(self) -> Bools:
        """Whether two vertices have an entry in the second derivative, (m, m)."""
        found = np.zeros((len(self.vertices), len(self.vertices)), dtype=bool)
        found[self.edges[:, 0], self.edges[:, 1]] = True
        return np.asarray(found | found.T)

    def volume(self, x: Floats) -> float:
        """Return v in m³."""
        one, two = x[self.edges].transpose(1, 0, 2)
        return float(np.cross(one, two).sum(axis=0) @ self.apex) / 6

    def gradient(self, x: Floats) -> Floats:
        """Return dv/dx, (m, 3), in m²."""
        out = np.zeros_like(x)
        np.add.at(out, self.edges[:, 0], np.cross(x[self.edges[:, 1]], self.apex))
        np.add.at(out, self.edges[:, 1], np.cross(self.apex, x[self.edges[:, 0]]))
        return out / 6

    def hessian(self, x: Floats) -> Floats:
        """Return d²v/dx², (3 m, 3 m), in m: a constant."""
        count = len(x)
        turn = _skew(self.apex[None])[0]
        out = np.zeros((count, count, 3, 3))
        np.add.at(out, (self.edges[:, 0], self.edges[:, 1]), -turn)
        np.add.at(out, (self.edges[:, 1], self.edges[:, 0]), turn)
        return np.asarray(out.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count) / 6)


def find_lids(pattern: Pattern, chambers: Chambers | None, supports: Supports) -> list[Lid]:
    """Return the lids of all chambers; none if the skin is not closed.

    Raises:
        ParameterError: What closes a border is not unique.
    """
    if not supports.close(pattern):
        return []
    closure, lids = supports.closure(pattern), []
    for (axis, at), border in zip(closure.planes, closure.borders, strict=True):
        ends = half_edges(pattern.triangles)[border]
        owner = 0 * border if chambers is None else chambers.of_cell[border // 3]
        apex = np.where(np.arange(3) == axis, at - closure.origin[axis], 0.0)
        for chamber in np.unique(owner):
            vertices, edges = np.unique(ends[owner == chamber], return_inverse=True)
            lids.append(Lid(vertices, edges.reshape(-1, 2), apex, (int(chamber), -1)))
    return lids


def _skew(a: Floats) -> Floats:
    """Return the matrices (m, 3, 3) of x ↦ a × x for vectors a, (m, 3)."""
    turned: Floats = np.cross(a[:, None, :], np.eye(3)).astype(np.float64)
    return turned.transpose(0, 2, 1)


def find_walls(pattern: Pattern, chambers: Chambers, supports: Supports) -> list[Wall]:
    """Return the walls between chambers.

    A border that ends where three chambers meet is closed by the chord to its other end, the line
    where three walls meet.

    Raises:
        ParameterError: The chambers are made for another pattern; a border ends at a free edge
            outside all symmetry planes; or too many chambers meet, so that the chords leave one
            open.
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
    in_plane = supports.in_planes(pattern)
    walls, chords = [], []
    for pair in np.unique(sides, axis=0):
        following: dict[int, list[int]] = {}
        for a, b in edges[(sides == pair).all(axis=1)].tolist():
            following.setdefault(a, []).append(b)
        for path in _paths(following, stops):
            wall = _wall(path, (int(pair[0]), int(pair[1])), at_border, in_plane)
            walls.append(wall)
            if wall.closed and path[0] != path[-1]:
                chords.append((wall.sides, path[0], path[-1]))
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


def _paths(following: dict[int, list[int]], stops: npt.NDArray[np.bool_]) -> list[list[int]]:
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


def _wall(
    path: list[int],
    sides: tuple[int, int],
    at_border: npt.NDArray[np.bool_],
    in_plane: npt.NDArray[np.bool_],
) -> Wall:
    cut = [end for end in (path[0], path[-1]) if at_border[end]]
    if not cut:
        vertices = np.array(path[:-1] if path[0] == path[-1] else path)
        even = np.full(len(vertices), 1 / len(vertices))
        return Wall(vertices, True, sides, even, np.ones(3))
    if len(cut) == 1 or not in_plane[cut].any(axis=1).all():
        raise ParameterError(
            f"the border between chambers {sides[0]} and {sides[1]} runs from vertex {path[0]} to "
            f"{path[-1]}: it must be a loop, or have both ends fixed in symmetry planes, or join "
            "other borders at both; of two planes across one axis, only that nearer to the origin "
            "may cut it. Move the chambers' borders, or simulate the whole skin."
        )
    weights: Floats = np.ones(len(path))  # a mirrored whole has the inner ones twice as often
    weights[[0, -1]] = 0.5
    weights /= weights.sum()
    kept = np.where(in_plane[cut].any(axis=0), 0.0, 1.0)
    return Wall(np.array(path), False, sides, weights, kept)


def _require_bodies(chords: list[tuple[tuple[int, int], int, int]], chambers: Chambers) -> None:
    """Check that the chords of each chamber's walls cancel."""
    open_chords: dict[tuple[int, int, int], int] = {}
    for sides, a, b in chords:
        for side, sign in zip(sides, (1, -1), strict=True):
            key = (side, min(a, b), max(a, b))
            open_chords[key] = open_chords.get(key, 0) + (sign if a < b else -sign)
    for (side, a, b), count in open_chords.items():
        if count:
            raise ParameterError(
                f"chamber {chambers.names[side]!r} meets others at three points or more, among "
                f"them vertices {a} and {b}: the walls there are not unique. Let at most two "
                "points be common to three chambers."
            )
