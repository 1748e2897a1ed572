"""Supports: fixed position components, and borders where the sheet keeps its direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations, product
from typing import Any

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    checked_floats,
    is_number,
    require_callable,
    require_finite,
    require_kind,
    require_names,
    shown,
    whole_numbers,
)
from toros_fem.meshes.mirror import FLAT, mirrored, plane_border
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.refine import Refinement
from toros_fem.meshes.topology import edge_keys, following, half_edges

# Cosine between a guided edge and the normal of its plane.
SQUARE = 1e-3


def _no_edges() -> Ints:
    return np.zeros((0, 2), dtype=np.int64)


def _no_normals() -> Floats:
    return np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class Closure:
    """Planes that close the free borders of a skin, for its volume.

    A cone from the origin over a wall that is missing in a plane through the origin has no volume.
    Where planes cut the skin on both sides, as z = 0 and z = L do, one of them does not contain
    the origin: there a lid must be counted.

    Attributes:
        origin: Point from which cones are taken, (3,), in m.
        planes: Axis and coordinate in m of the plane of each lid.
        borders: Free half-edges that bound each lid, (k,).
    """

    origin: Floats
    planes: tuple[tuple[int, float], ...]
    borders: tuple[Ints, ...]


@dataclass(frozen=True, eq=False)
class Supports:
    """Fixed position components, and free edges at which the sheet keeps its direction.

    Attributes:
        fixed: Whether each component x, y, z of each assembled vertex is fixed, shape (n, 3).
        guided: Ends of free edges, shape (k, 2), at which the sheet stays perpendicular to a
            given plane through the edge, as if mirrored there: it cannot turn about the edge.
            `fixed` says whether the edge itself is fixed.
        normals: Normal of each of these planes, shape (k, 3), perpendicular to the edge, of any
            length. An edge that is not fixed may move, but its plane does not turn.
        displacement: Displacement in m of the fixed components from their assembled positions,
            shape (n, 3); None leaves all at their assembled positions. It is part of the load and
            raised together with it.
        planes: Axis and coordinate in m of each symmetry plane that closes a free border.

    Raises:
        ParameterError: `guided` and `normals` do not fit together, or a normal is zero; or the
            displacement has another shape than `fixed`, or is not finite.
    """

    fixed: Bools
    guided: Ints = field(default_factory=_no_edges)
    normals: Floats = field(default_factory=_no_normals)
    displacement: Floats | None = None
    planes: tuple[tuple[int, float], ...] = ()

    def __post_init__(self) -> None:
        fixed = np.asarray(self.fixed)
        if fixed.dtype != bool or fixed.ndim != 2 or fixed.shape[1] != 3:
            raise ParameterError(
                f"fixed = {shown(self.fixed)} must be True or False for each component, (n, 3). "
                "clamp and clamp_where make it."
            )
        object.__setattr__(self, "fixed", fixed)
        what = "ends of free edges, (k, 2)"
        guided = whole_numbers("guided", self.guided, what)
        if guided.ndim != 2:
            raise ParameterError(f"guided has shape {guided.shape}; it must be {what}.")
        object.__setattr__(self, "guided", guided)
        what = "normals of planes, (k, 3)"
        normals = checked_floats("normals", self.normals, what, lambda _: True, finite=False)
        object.__setattr__(self, "normals", normals)
        moved = require_displacement(self.displacement, fixed.shape)
        object.__setattr__(self, "displacement", moved)
        for plane in self.planes if isinstance(self.planes, list | tuple) else [None]:
            pair = isinstance(plane, list | tuple) and len(plane) == 2
            if not (pair and plane[0] in (0, 1, 2) and is_number(plane[1])):
                raise ParameterError(
                    f"planes = {shown(self.planes)} must be a list of pairs: axis 0, 1 or 2, and "
                    "coordinate in m. symmetry_plane makes them."
                )
        object.__setattr__(self, "planes", tuple(self.planes))
        count = len(self.guided)
        if self.guided.shape != (count, 2) or self.normals.shape != (count, 3):
            raise ParameterError(
                f"guided has shape {self.guided.shape} and normals {self.normals.shape}; they "
                "must be (k, 2) and (k, 3)."
            )
        length = np.linalg.norm(self.normals, axis=1)
        if not (np.isfinite(length) & (length > 0)).all():
            raise ParameterError("each row of normals must be finite and not zero.")

    def __or__(self, other: Supports) -> Supports:
        """Return the union; where both fix something, the second's values count."""
        displacement = None
        if self.displacement is not None or other.displacement is not None:
            mine, theirs = (
                np.zeros(s.fixed.shape) if s.displacement is None else s.displacement
                for s in (self, other)
            )
            displacement = np.where(other.fixed, theirs, np.where(self.fixed, mine, 0.0))
        return Supports(
            self.fixed | other.fixed,
            np.concatenate([self.guided, other.guided]),
            np.concatenate([self.normals, other.normals]),
            displacement,
            tuple(dict.fromkeys(self.planes + other.planes)),
        )

    def refined(self, finer: Refinement) -> Supports:
        """Return supports of a refined pattern: a middle is fixed if both its ends are.

        This is right for whole panels and straight borders.
        """
        fixed = np.asarray(self.fixed[finer.ends].all(axis=1))
        displacement = None
        if self.displacement is not None:
            displacement = finer.at_vertices(self.displacement)
        if not len(self.guided):
            return Supports(fixed, displacement=displacement, planes=self.planes)
        count = len(self.fixed)
        known = edge_keys(finer.ends[count:], count)
        middle = count + np.searchsorted(known, edge_keys(self.guided, count))
        halves = np.stack([self.guided, np.repeat(middle[:, None], 2, axis=1)], axis=2)
        normals = np.repeat(self.normals, 2, axis=0)
        return Supports(fixed, halves.reshape(-1, 2), normals, displacement, self.planes)

    def close(self, pattern: Pattern) -> bool:
        """Return whether a pressure can act: the skin is closed, or planes close it.

        A free border is closed by a symmetry plane, or by a coordinate plane through the origin in
        which it is fixed.
        """
        return bool((self._closing_planes(pattern)[0] >= 0).all())

    def closure(self, pattern: Pattern) -> Closure:
        """Return how planes close the free borders of a skin that they close.

        Raises:
            ParameterError: A border lies in two planes, or runs from one lid to another.
        """
        axis, position = self._closing_planes(pattern)
        origin = self._origin
        off = (axis >= 0) & (position != origin[axis])
        lids = []
        borders = np.full(len(pattern.points), -1)
        for k, at in sorted(set(zip(axis[off].tolist(), position[off].tolist(), strict=True))):
            edges = pattern.free_edges[off & (axis == k) & (position == at)]
            for j, other in self.planes:
                if (j, other) != (k, at) and self._held(pattern, j, other)[edges].all(axis=1).any():
                    raise ParameterError(
                        f"a free edge lies in both planes {'xyz'[k]} = {at:g} m and {'xyz'[j]} = "
                        f"{other:g} m, so that what closes it is not unique. Move a plane."
                    )
            there = borders[edges]
            if ((there >= 0) & (there != k)).any():
                raise ParameterError(
                    f"planes cut the skin on both sides along {'xyz'[k]} and along "
                    f"{'xyz'[there[there >= 0].max()]}, and a border runs from the one to the "
                    "other. Let one of the four planes be no symmetry plane: simulate more."
                )
            borders[edges] = k
            lids.append((k, at))
        numbers = pattern.edges.twins[pattern.edges.border, 0]
        return Closure(
            origin,
            tuple(lids),
            tuple(numbers[off & (axis == k) & (position == at)] for k, at in lids),
        )

    def in_planes(self, pattern: Pattern) -> Bools:
        """Return whether each vertex lies in `closure`'s plane across x, y or z, (n, 3).

        Where edges are guided their normals decide, since a clamp may fix more components.
        """
        across = np.zeros(self.fixed.shape, dtype=bool)
        lengths = np.linalg.norm(self.normals, axis=1)[:, None]
        for k in range(2):
            np.logical_or.at(across, self.guided[:, k], np.abs(self.normals) > 0.999 * lengths)
        guided = np.asarray(across.any(axis=1))[:, None]
        held = [self._held(pattern, k, at) for k, at in enumerate(self._origin)]
        return np.asarray(np.stack(held, axis=1) & (across | ~guided))

    def in_symmetry_planes(self, pattern: Pattern) -> Bools:
        """Return whether each vertex is held in a plane of `planes` across x, y or z, (n, 3)."""
        found = np.zeros(self.fixed.shape, dtype=bool)
        for axis, at in self.planes:
            found[:, axis] |= self._held(pattern, axis, at)
        return found

    @property
    def _origin(self) -> Floats:
        """A point, (3,), in one plane across each axis that has planes: if possible at 0."""
        origin = np.zeros(3)
        for axis in range(3):
            found = [at for k, at in self.planes if k == axis]
            origin[axis] = min(found, key=abs, default=0.0)
        return origin

    def _closing_planes(self, pattern: Pattern) -> tuple[Ints, Floats]:
        """Axis and coordinate of the plane that closes each free edge; axis −1 without one.

        Planes through `_origin` come first: there nothing is missing from the volume.
        """
        ends, origin = pattern.free_edges, self._origin
        axis = np.full(len(ends), -1)
        position = np.zeros(len(ends))
        planes = [*self.planes, *((k, 0.0) for k in range(3))]
        for k, at in sorted(planes, key=lambda plane: plane[1] == origin[plane[0]]):
            held = self._held(pattern, k, at)
            # A sheet that lies in the plane as a whole encloses nothing with it.
            inside = held[ends].all(axis=1) & ~held.all()
            axis[inside], position[inside] = k, at
        return axis, position

    def _held(self, pattern: Pattern, axis: int, at: float) -> Bools:
        """Whether each vertex is fixed in a plane, and stays there."""
        rest = pattern.points[:, axis] - at
        moved = rest if self.displacement is None else rest + self.displacement[:, axis]
        near = FLAT * pattern.size
        return np.asarray(self.fixed[:, axis] & (np.abs(rest) <= near) & (np.abs(moved) <= near))

    def require_no_rigid_motion(self, pattern: Pattern, *, bends: bool = True) -> None:
        """Check that no rigid motion of the assembled skin is left free.

        Args:
            pattern: The pattern.
            bends: Whether the sheet resists bending; guided edges do not act on a membrane.

        Raises:
            ParameterError: The supports are made for another pattern, guide an edge that is not
                free, or leave a rigid motion.
        """
        points = pattern.points
        if self.fixed.shape != points.shape:
            raise ParameterError(
                f"supports.fixed has shape {self.fixed.shape}; this skin needs {points.shape}. "
                "Make the supports from its own pattern."
            )
        self._check_guides(pattern)
        arm = (points - points.mean(axis=0)) / pattern.size
        shifts = np.broadcast_to(np.eye(3), (len(points), 3, 3))
        turns = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=2)
        motions = np.concatenate([shifts, turns], axis=2)[self.fixed]
        if bends:  # a guided edge does not let the sheet turn about it
            along = points[self.guided[:, 1]] - points[self.guided[:, 0]]
            guides = np.concatenate([np.zeros_like(along), along / pattern.size], axis=1)
            motions = np.concatenate([motions, guides])
        rank = np.linalg.matrix_rank(motions, tol=1e-6) if len(motions) else 0
        if rank < 6:
            raise ParameterError(
                f"the supports fix {self.fixed.sum()} components and leave {6 - rank} of the 6 "
                "rigid motions free, so that the skin could float away. Fix more components."
            )

    def _check_guides(self, pattern: Pattern) -> None:
        points = pattern.points
        free, guided = (edge_keys(e, len(points)) for e in (pattern.free_edges, self.guided))
        inside = ~np.isin(guided, free)
        if inside.any():
            a, b = self.guided[np.flatnonzero(inside)[0]]
            raise ParameterError(
                f"guided contains the edge between vertices {a} and {b}, which is no free edge of "
                "this pattern. Inside the skin fix vertices on both sides of the edge instead."
            )
        along = points[self.guided[:, 1]] - points[self.guided[:, 0]]
        lengths = np.linalg.norm(along, axis=1) * np.linalg.norm(self.normals, axis=1)
        askew = np.abs(np.einsum("ij,ij->i", along, self.normals)) > SQUARE * lengths
        if askew.any():
            k = int(np.flatnonzero(askew)[0])
            raise ParameterError(
                f"the normal {self.normals[k]} of the guided edge between vertices "
                f"{self.guided[k, 0]} and {self.guided[k, 1]} is not perpendicular to it: the "
                "plane that mirrors the sheet there must go through the edge."
            )


def require_displacement(displacement: Any, shape: tuple[int, ...]) -> Floats | None:
    """Return a displacement of all assembled vertices as an array; None passes.

    Raises:
        ParameterError: It does not fit, or is not finite.
    """
    if displacement is None:
        return None
    what = f"finite and of shape {shape}, in m, one row for each assembled vertex"
    return checked_floats("displacement", displacement, what, shape)


def clamp(pattern: Pattern, panels: Sequence[str]) -> Supports:
    """Fix every vertex of the named panels in all three components.

    Raises:
        PanelError: A panel of that name does not exist.
        ParameterError: `panels` is no list of names, or it is empty, so that the skin could move
            as a rigid body.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    require_names("panels", panels)
    if not panels:
        raise ParameterError("panels = () fixes nothing; name a panel to clamp.")
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    for name in panels:
        fixed[pattern.vertices_of(name)] = True
    return Supports(fixed)


def clamp_where(pattern: Pattern, where: Callable[[Floats], Bools]) -> Supports:
    """Fix every vertex in a region of space in all three components.

    Args:
        pattern: The pattern.
        where: Returns for assembled positions (n, 3), in m, whether each lies in the region, (n,):
            `lambda x: x[:, 2] < 5e-3` for instance.

    Raises:
        ParameterError: The region holds no vertex, or `where` returns something else.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    require_callable("where", where, "a function of the positions (n, 3)")
    inside = np.asarray(where(pattern.points.copy()))
    if inside.dtype != bool or inside.shape != (len(pattern.points),):
        raise ParameterError(
            f"where returned {inside.dtype} of shape {inside.shape}; it must return True or False "
            f"for each of the {len(pattern.points)} vertices."
        )
    if not inside.any():
        low, high = pattern.points.min(axis=0), pattern.points.max(axis=0)
        raise ParameterError(
            f"the region holds no vertex; the skin spans {low} to {high}, in m. Check its unit and "
            "its axes."
        )
    return Supports(np.repeat(inside[:, None], 3, axis=1))


def displace(
    pattern: Pattern, panels: Sequence[str], displacement: Sequence[float] | Floats
) -> Supports:
    """Fix every vertex of the named panels in all components, moved by one vector.

    Args:
        pattern: The pattern.
        panels: Names of the panels.
        displacement: Displacement from the assembled positions, (3,), in m.

    Raises:
        PanelError: A panel of that name does not exist.
        ParameterError: No panel is named, or the displacement is no finite vector.
    """
    fixed = clamp(pattern, panels).fixed
    vector = checked_floats("displacement", displacement, "a finite vector (3,), in m", (3,))
    return Supports(fixed, displacement=np.where(fixed, vector, 0.0))


def pin(pattern: Pattern, panel: str | None = None) -> Supports:
    """Fix six components that prevent rigid motion and nothing else.

    Of three vertices far apart one is fixed in three components, one in two, one in one (the
    3-2-1 rule of fixtures). The components are those that resist the weakest rigid motion best.
    The reactions of an inflated skin are zero.

    Args:
        pattern: The pattern.
        panel: Panel of the three vertices; None for any place.

    Raises:
        PanelError: There is no such panel.
        ParameterError: The vertices lie on a line.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    among = np.arange(len(pattern.points)) if panel is None else pattern.vertices_of(panel)
    arm = (pattern.points[among] - pattern.points[among].mean(axis=0)) / pattern.size
    first = int(np.argmax(np.linalg.norm(arm, axis=1)))
    second = int(np.argmax(np.linalg.norm(arm - arm[first], axis=1)))
    third = int(np.argmax(np.linalg.norm(np.cross(arm - arm[first], arm[second] - arm[first]),
                                         axis=1)))  # fmt: skip
    turns = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=2)
    motions = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)
    best, chosen = 0.0, None
    for a, b, c in permutations((first, second, third)):
        for left_out, last in product(range(3), range(3)):
            fixed = np.zeros(arm.shape, dtype=bool)
            fixed[a], fixed[b], fixed[c, last] = True, np.arange(3) != left_out, True
            stiffness = float(np.linalg.svd(motions[fixed], compute_uv=False)[-1])
            if fixed.sum() == 6 and stiffness > best * (1 + 1e-9):  # the first of equals
                best, chosen = stiffness, fixed
    if chosen is None or best < 1e-4:
        raise ParameterError(
            "the vertices to pin lie on a line, so that the skin could turn about it; give a panel "
            "that spans an area, or none."
        )
    whole = np.zeros(pattern.points.shape, dtype=bool)
    whole[among] = chosen
    return Supports(whole)


def symmetry_plane(pattern: Pattern, axis: int, at: float = 0.0) -> Supports:
    """Fix the free border of half a skin in its mirror plane, across a coordinate axis.

    The border slides in the plane and the sheet stays perpendicular to it. The plane closes the
    border for a pressure. Several planes are joined by `|`; two across one axis bound a section of
    a skin that repeats.

    Args:
        pattern: Half a skin, or a quarter, or a section.
        axis: 0, 1 or 2 for the plane x = at, y = at or z = at.
        at: Coordinate of the plane in m.

    Raises:
        ParameterError: No free edge lies in the plane.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    if isinstance(axis, bool) or not isinstance(axis, int | np.integer) or axis not in (0, 1, 2):
        raise ParameterError(f"axis = {shown(axis)} must be 0, 1 or 2, for x, y or z.")
    require_finite(at=at)
    border = half_edges(pattern.triangles)[plane_border(pattern, axis, at)]
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[border.ravel(), axis] = True
    normals = np.tile(np.eye(3)[axis], (len(border), 1))
    return Supports(fixed, border, normals, planes=((axis, float(at)),))


def symmetry_planes(pattern: Pattern, axes: Sequence[int], *, hinged: bool = False) -> Supports:
    """Return the supports of a part in all planes through the origin that it is cut at.

    Args:
        pattern: The part.
        axes: Normals of the planes, as of `meshes.mirrored`.
        hinged: Whether seams carry no moment: the sheet turns freely at a cut that is a seam of
            the whole.
    """
    supports = Supports(np.zeros((len(pattern.points), 3), dtype=bool))
    for axis in axes:
        supports |= symmetry_plane(pattern, axis)
    if not hinged or not len(axes):
        return supports
    seams = mirrored(pattern, axes).pattern.seam_edges[: len(pattern.panel)]
    triangles, count = pattern.triangles, len(pattern.points)
    ends = np.stack([np.roll(triangles, -1, axis=1), np.roll(triangles, -2, axis=1)], axis=2)
    kept = ~np.isin(edge_keys(supports.guided, count), edge_keys(ends[seams], count))
    return replace(supports, guided=supports.guided[kept], normals=supports.normals[kept])


def build_in(pattern: Pattern, vertices: Bools) -> Supports:
    """Fix a part of the free border, and the direction of the sheet there.

    Args:
        pattern: The pattern.
        vertices: Whether each assembled vertex is chosen, (n,): free edges between two chosen ones
            are built in.

    Raises:
        ParameterError: `vertices` does not fit, or no free edge lies between them.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    vertices = np.asarray(vertices)
    if vertices.dtype != bool or vertices.shape != (len(pattern.points),):
        raise ParameterError(
            f"vertices is {vertices.dtype} of shape {vertices.shape}; it must be True or "
            f"False for each of the {len(pattern.points)} assembled vertices."
        )
    chosen = vertices[pattern.free_edges].all(axis=1)
    if not chosen.any():
        raise ParameterError("no free edge lies between the vertices to be built in.")
    ends = pattern.free_edges[chosen]
    border = pattern.edges.twins[pattern.edges.border[chosen], 0]
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[ends.ravel()] = True
    return Supports(fixed, ends, _inward_normals(pattern, border))


def _inward_normals(pattern: Pattern, border: Ints) -> Floats:
    """Return unit vectors (k, 3) in the assembled sheet, from free half-edges (k,) into it."""
    a, b = pattern.points[half_edges(pattern.triangles)[border]].transpose(1, 0, 2)
    across = pattern.triangles.ravel()[following(following(border))]
    along = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    inward = pattern.points[across] - a
    inward -= np.einsum("ij,ij->i", inward, along)[:, None] * along
    return np.asarray(inward / np.linalg.norm(inward, axis=1)[:, None])
