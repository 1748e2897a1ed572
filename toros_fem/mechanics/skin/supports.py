"""Supports: fixed position components, and borders where the sheet keeps its direction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import permutations, product
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    NAMES,
    Bools,
    Floats,
    Ints,
    checked_bools,
    checked_floats,
    checked_list,
    require_callable,
    require_count,
    require_finite,
    require_kind,
    vector,
    whole_numbers,
)
from toros_fem.meshes.pattern import FLAT, Pattern, mirrored, plane_border
from toros_fem.meshes.triangles import edge_keys, following, half_edges, linked, opposite_edges

if TYPE_CHECKING:
    from toros_fem.meshes.transfer import OtherMesh

# Number of what closes a border in place of the axis of a plane.
RIM = 3
# Cosine between a guided edge and the normal of its plane.
SQUARE = 1e-3


@dataclass(frozen=True, eq=False)
class Supports:
    """Fixed position components, and free edges at which the sheet keeps its direction.

    Attributes:
        fixed: Whether each component x, y, z of each assembled vertex is fixed, shape (n, 3).
        guided: Ends of free edges, shape (k, 2), at which the sheet stays perpendicular to a given
            plane through the edge, as if mirrored there: it cannot turn about the edge. `fixed`
            says whether the edge itself is fixed.
        normals: Normal of each of these planes, shape (k, 3), perpendicular to the edge, of any
            length. An edge that is not fixed may move, but its plane does not turn.
        displacement: Displacement in m of the fixed components from their assembled positions,
            shape (n, 3); None leaves all at their assembled positions. It is part of the load and
            raised together with it.
        planes: Axis and coordinate in m of each symmetry plane that closes a free border.
    """

    fixed: Bools
    guided: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    normals: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    displacement: Floats | None = None
    planes: tuple[tuple[int, float], ...] = ()

    def __post_init__(self) -> None:
        fixed = checked_bools("fixed", self.fixed, "component", (len(self.fixed), 3))
        guided = whole_numbers("guided", self.guided, "ends of free edges, (k, 2)")
        shape = (len(guided), 3)
        normals = checked_floats("normals", self.normals, f"of shape {shape}, as guided", shape)
        moved = self.displacement
        if moved is not None:
            what = f"finite and of shape {fixed.shape}, in m, one row for each assembled vertex"
            moved = checked_floats("displacement", moved, what, fixed.shape)
        checked = (fixed, guided, normals, moved, tuple(self.planes))
        for one, value in zip(fields(self), checked, strict=True):
            object.__setattr__(self, one.name, value)

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

    def refined(self, finer: OtherMesh) -> Supports:
        """Return supports of a finer mesh: a vertex is fixed if all between which it lies are.

        This is right for whole panels and straight borders. In place of a fixed vertex that is gone
        the nearest one is fixed.
        """
        displacement, count = self.displacement, len(self.fixed)
        if displacement is not None:
            displacement = finer.at_vertices(displacement)
        on_edge = edge_keys(finer.source.free_edges, count)[finer.free_edges()]
        guide, edge = np.nonzero(edge_keys(self.guided, count)[:, None] == on_edge)
        fixed = np.asarray(self.fixed[finer.ends].all(axis=1))
        seen = np.zeros_like(self.fixed)
        for axis in range(3):
            seen[finer.ends[fixed[:, axis]], axis] = True
        lone, held = np.nonzero(self.fixed & ~seen)
        if len(lone):
            near = cKDTree(finer.pattern.points).query(finer.source.points[lone])[1]
            fixed[near, held] = True
        return Supports(
            fixed,
            finer.pattern.free_edges[edge],
            self.normals[guide],
            displacement,
            self.planes,
        )

    def require_no_rigid_motion(self, pattern: Pattern, *, bends: bool = True) -> None:
        """Check that these are supports of a pattern that leave no rigid motion free.

        Guided edges act where the sheet resists bending, not on a membrane.
        """
        for fault in self._faults(pattern, bends=bends):
            raise ParameterError(fault)

    def _faults(self, pattern: Pattern, *, bends: bool) -> Iterator[str]:
        """Yield why they do not hold a skin of a pattern, as sentences."""
        points = pattern.points
        if self.fixed.shape != points.shape:
            yield (
                f"supports.fixed has shape {self.fixed.shape}; this skin needs {points.shape}. "
                "Make the supports from its own pattern."
            )
        free, guided = (edge_keys(e, len(points)) for e in (pattern.free_edges, self.guided))
        inside = ~np.isin(guided, free)
        if inside.any():
            a, b = self.guided[np.flatnonzero(inside)[0]]
            yield (
                f"guided contains the edge between vertices {a} and {b}, which is no free edge of "
                "this pattern. Inside the skin fix vertices on both sides of the edge instead."
            )
        along = points[self.guided[:, 1]] - points[self.guided[:, 0]]
        lengths = np.linalg.norm(along, axis=1) * np.linalg.norm(self.normals, axis=1)
        square = np.abs(np.einsum("ij,ij->i", along, self.normals)) <= SQUARE * lengths
        askew = ~(square & (lengths > 0))
        if askew.any():
            k = int(np.flatnonzero(askew)[0])
            yield (
                f"the normal {self.normals[k]} of the guided edge between vertices "
                f"{self.guided[k, 0]} and {self.guided[k, 1]} is not perpendicular to it: the "
                "plane that mirrors the sheet there must go through the edge."
            )
        motions = _rigid_motions(_arms(points, pattern.size))[self.fixed]
        if bends:  # a guided edge does not let the sheet turn about it
            guides = np.concatenate([np.zeros_like(along), along / pattern.size], axis=1)
            motions = np.concatenate([motions, guides])
        rank = np.linalg.matrix_rank(motions, tol=1e-6) if len(motions) else 0
        if rank < 6:
            yield (
                f"the supports fix {self.fixed.sum()} components and leave {6 - rank} of the 6 "
                "rigid motions free, so that the skin could float away. Fix more components."
            )


def _arms(points: Floats, size: float) -> Floats:
    """Return points from their mean over a size, (n, 3)."""
    return np.asarray((points - points.mean(axis=0)) / size)


def _rigid_motions(arms: Floats) -> Floats:
    """Return motions of points by three shifts and three turns, (n, 3, 6)."""
    turns = np.stack([np.cross(axis, arms) for axis in np.eye(3)], axis=2)
    return np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)


def _none_fixed(pattern: Pattern) -> Bools:
    """Return that no component is fixed, (n, 3), of what is checked to be a pattern."""
    require_kind("pattern", pattern, Pattern, "a Pattern")
    return np.zeros((len(pattern.points), 3), dtype=bool)


def clamp(pattern: Pattern, panels: Sequence[str]) -> Supports:
    """Fix every vertex of the named panels in all three components.

    Raises:
        PanelError: A panel of that name does not exist.
    """
    fixed = _none_fixed(pattern)
    fixed[vertices_of_panels(pattern, panels)] = True
    return Supports(fixed)


def clamp_where(pattern: Pattern, where: Callable[[Floats], Bools]) -> Supports:
    """Fix every vertex in a region of space in all three components.

    `where` returns for assembled positions (n, 3), in m, whether each lies in the region, (n,):
    `lambda x: x[:, 2] < 5e-3` for instance. A region without a vertex is a ParameterError.
    """
    fixed = _none_fixed(pattern)
    require_callable("where", where, "a function of the positions (n, 3)")
    found = where(pattern.points.copy())
    inside = checked_bools("the result of where", found, "vertex", fixed.shape[:1])
    if not inside.any():
        low, high = pattern.points.min(axis=0), pattern.points.max(axis=0)
        raise ParameterError(
            f"the region holds no vertex; the skin spans {low} to {high}, in m. Check its unit and "
            "its axes."
        )
    fixed[inside] = True
    return Supports(fixed)


def displace(
    pattern: Pattern,
    panels: Sequence[str],
    displacement: Sequence[float] | Floats,
    *,
    turn: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    about: Sequence[float] | Floats | None = None,
    components: str = "xyz",
) -> Supports:
    """Hold the named panels, moved as a rigid body from their assembled positions.

    Args:
        pattern, panels: The pattern, and names of panels.
        displacement: Shift, (3,), in m.
        turn: Rotation vector, (3,), in rad.
        about: Point that they turn about, (3,), in m; None takes the centre of their area.
        components: Components that are held, "z" or "xy" for instance; the others are free, vertex
            by vertex. `solve_rigid` frees a panel as a whole.

    Raises:
        PanelError: A panel of that name does not exist.
        ParameterError: There is no such component.
    """
    if not components or set(components) - set("xyz"):
        raise ParameterError(
            f'components = {components!r} must name axes, as "xyz" or "z", of which each is held.'
        )
    fixed = clamp(pattern, panels).fixed
    moved = rigid_displacement(pattern, panels, displacement, turn, about)
    fixed &= np.array([axis in components for axis in "xyz"])
    return Supports(fixed, displacement=np.where(fixed, moved, 0.0))


def rigid_displacement(
    pattern: Pattern,
    panels: Sequence[str],
    shift: Sequence[float] | Floats,
    turn: Sequence[float] | Floats = (0.0, 0.0, 0.0),
    about: Sequence[float] | Floats | None = None,
) -> Floats:
    """Return the displacement in m of all vertices, (n, 3), by which panels move as a rigid body.

    It is zero elsewhere: a `Load` takes it, where supports hold the panels. Arguments are those of
    `displace`.
    """
    vertices = vertices_of_panels(pattern, panels)
    moves = checked_floats("displacement", shift, "a finite vector (3,), in m", (3,))
    angles = vector("turn", turn)
    point = centre_of(pattern, panels, pattern.points)
    if about is not None:
        point = vector("about", about)
    arms = pattern.points[vertices] - point
    moved: Floats = np.zeros((len(pattern.points), 3))
    moved[vertices] = moves + Rotation.from_rotvec(angles).apply(arms) - arms
    return moved


def vertices_of_panels(pattern: Pattern, panels: Sequence[str]) -> Ints:
    """Return the assembled vertices of panels, by their names, each once."""
    require_kind("pattern", pattern, Pattern, "a Pattern")
    checked_list("panels", panels, str, NAMES)
    if not panels:
        raise ParameterError("panels = () names no panel; name one at least.")
    return np.unique(np.concatenate([pattern.vertices_of(name) for name in panels]))


def centre_of(pattern: Pattern, panels: Sequence[str], positions: Floats) -> Floats:
    """Return the centre of the area of panels, (3,), at positions of all vertices, (n, 3), in m."""
    cells = np.concatenate([pattern.cells_of(name) for name in panels])
    middles = positions[pattern.triangles[cells]].mean(axis=1)
    return np.asarray(np.average(middles, axis=0, weights=pattern.areas[cells]))


def pin(pattern: Pattern, panel: str | None = None) -> Supports:
    """Fix six components that prevent rigid motion and nothing else.

    Of three vertices far apart one is fixed in three components, one in two, one in one (the 3-2-1
    rule of fixtures), all of one panel, or anywhere. The components are those that resist the
    weakest rigid motion best. The reactions of an inflated skin are zero. Vertices on a line are a
    ParameterError.
    """
    whole = _none_fixed(pattern)
    among = np.arange(len(pattern.points)) if panel is None else pattern.vertices_of(panel)
    arm = _arms(pattern.points[among], pattern.size)
    motions = _rigid_motions(arm)
    first = int(np.argmax(np.linalg.norm(arm, axis=1)))
    second = int(np.argmax(np.linalg.norm(arm - arm[first], axis=1)))
    third = int(np.argmax(np.linalg.norm(np.cross(arm - arm[first], arm[second] - arm[first]),
                                         axis=1)))  # fmt: skip
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
    whole[among] = chosen
    return Supports(whole)


def symmetry_plane(pattern: Pattern, axis: int, at: float = 0.0) -> Supports:
    """Fix the free border of half a skin in its mirror plane, across a coordinate axis, at `at` m.

    The border slides in the plane and the sheet stays perpendicular to it. The plane closes the
    border for a pressure. Several planes are joined by `|`: of a quarter, or, two across one axis,
    of a section of a skin that repeats. No free edge in the plane is a ParameterError.
    """
    fixed = _none_fixed(pattern)
    require_count(0, at_most=2, axis=axis)
    require_finite(at=at)
    border = half_edges(pattern.triangles)[plane_border(pattern, axis, at)]
    fixed[border.ravel(), axis] = True
    normals = np.tile(np.eye(3)[axis], (len(border), 1))
    return Supports(fixed, border, normals, planes=((axis, float(at)),))


def symmetry_planes(pattern: Pattern, axes: Sequence[int], *, hinged: bool = False) -> Supports:
    """Return the supports of a part in all planes through the origin that it is cut at.

    `axes` are the normals of the planes, as of `meshes.mirrored`. If `hinged`, seams carry no
    moment: the sheet turns freely at a cut that is a seam of the whole.
    """
    supports = Supports(_none_fixed(pattern))
    for axis in axes:
        supports |= symmetry_plane(pattern, axis)
    if not hinged or not len(axes):
        return supports
    seams = mirrored(pattern, axes).pattern.seam_edges[: len(pattern.panel)]
    seam_ends, count = opposite_edges(pattern.triangles)[seams], len(pattern.points)
    kept = ~np.isin(edge_keys(supports.guided, count), edge_keys(seam_ends, count))
    return replace(supports, guided=supports.guided[kept], normals=supports.normals[kept])


def build_in(pattern: Pattern, vertices: Bools) -> Supports:
    """Fix the free edges between chosen vertices, (n,), and the direction of the sheet there."""
    fixed = _none_fixed(pattern)
    vertices = checked_bools("vertices", vertices, "assembled vertex", fixed.shape[:1])
    chosen = vertices[pattern.free_edges].all(axis=1)
    if not chosen.any():
        raise ParameterError("no free edge lies between the vertices to be built in.")
    ends = pattern.free_edges[chosen]
    border = pattern.edges.twins[pattern.edges.border[chosen], 0]
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


class Planes:
    """What closes free borders: symmetry planes, coordinate planes through the origin, held rims.

    A border is closed by a plane in which it is fixed. One that is fixed in all components and lies
    in no such plane is a rim: the fan about its mean closes it. A cone from the origin over what is
    missing in a plane through the origin has no volume. Where planes cut the skin on both sides, as
    z = 0 and z = L do, one of them does not contain the origin: there a lid must be counted.

    Attributes:
        origin: Point from which cones are taken, (3,), in m: in one plane across each axis that
            has symmetry planes, if possible at 0.
    """

    def __init__(self, pattern: Pattern, supports: Supports) -> None:
        self._pattern, self._supports = pattern, supports
        self.origin = np.zeros(3)
        for axis in range(3):
            found = [at for k, at in supports.planes if k == axis]
            self.origin[axis] = min(found, key=abs, default=0.0)
        # Axis, −1 for none, and coordinate of the plane that closes each free edge. Planes through
        # the origin come last and win: there nothing is missing from the volume.
        ends = pattern.free_edges
        self._axis, self._at = np.full(len(ends), -1), np.zeros(len(ends))
        planes = [*supports.planes, *((k, 0.0) for k in range(3))]
        for k, at in sorted(planes, key=lambda plane: plane[1] == self.origin[plane[0]]):
            held = self._held(k, at)
            # A sheet that lies in the plane as a whole encloses nothing with it.
            inside = held[ends].all(axis=1) & ~held.all()
            self._axis[inside], self._at[inside] = k, at
        self._close_rims()

    def _close_rims(self) -> None:
        """Let borders that are fixed in all components, and in no plane as a whole, be rims."""
        ends = self._pattern.free_edges
        held: Bools = np.asarray(self._supports.fixed.all(axis=1))
        in_symmetry = np.zeros(len(ends), dtype=bool)
        for k, at in self._supports.planes:
            in_symmetry |= self._held(k, at)[ends].all(axis=1)
        others = np.flatnonzero(~in_symmetry)
        if held.all() or not len(others) or (self._axis >= 0).all():
            return
        begin, end = ends[others].T
        border = linked(begin, end, len(held))[begin]
        for one in np.unique(border[self._axis[others] < 0]):
            edges = others[border == one]
            if held[ends[edges]].all():
                self._axis[edges] = RIM

    @property
    def close(self) -> bool:
        """Whether a pressure can act: the skin is closed, or planes and rims close it."""
        return bool((self._axis >= 0).all())

    def moved_out(self, moved: Planes) -> bool:
        """Return whether a border has left the plane that closes it, where supports have moved."""
        return bool(((self._axis < RIM) & (moved._axis != self._axis)).any())

    def rims(self) -> Ints:
        """Return the free half-edges at rims, (k,)."""
        half = self._pattern.edges.twins[self._pattern.edges.border, 0]
        return np.asarray(half[self._axis == RIM])

    def lids(self) -> list[tuple[int, float, Ints]]:
        """Return axis and coordinate in m of each lid, and the free half-edges around it, (k,)."""
        pattern, axis, position = self._pattern, self._axis, self._at
        half = pattern.edges.twins[pattern.edges.border, 0]
        in_plane = (axis >= 0) & (axis < RIM)
        off = in_plane & (position != self.origin[np.where(in_plane, axis, 0)])
        borders = np.full(len(pattern.points), -1)
        found = []
        for k, at in sorted(set(zip(axis[off].tolist(), position[off].tolist(), strict=True))):
            there = off & (axis == k) & (position == at)
            edges = pattern.free_edges[there]
            for j, other in self._supports.planes:
                if (j, other) != (k, at) and self._held(j, other)[edges].all(axis=1).any():
                    raise ParameterError(
                        f"a free edge lies in both planes {'xyz'[k]} = {at:g} m and {'xyz'[j]} = "
                        f"{other:g} m, so that what closes it is not unique. Move a plane."
                    )
            before = borders[edges]
            if ((before >= 0) & (before != k)).any():
                raise ParameterError(
                    f"planes cut the skin on both sides along {'xyz'[k]} and along "
                    f"{'xyz'[before[before >= 0].max()]}, and a border runs from the one to the "
                    "other. Let one of the four planes be no symmetry plane: simulate more."
                )
            borders[edges] = k
            found.append((k, at, half[there]))
        return found

    def through_origin(self) -> Bools:
        """Return whether each vertex is held in a plane through the origin across x, y, z, (n, 3).

        Where edges are guided their normals decide, since a clamp may fix more components.
        """
        supports = self._supports
        across = np.zeros(supports.fixed.shape, dtype=bool)
        lengths = np.linalg.norm(supports.normals, axis=1)[:, None]
        for k in range(2):
            along = np.abs(supports.normals) > 0.999 * lengths
            np.logical_or.at(across, supports.guided[:, k], along)
        guided = np.asarray(across.any(axis=1))[:, None]
        held = [self._held(k, at) for k, at in enumerate(self.origin)]
        return np.asarray(np.stack(held, axis=1) & (across | ~guided))

    def of_symmetry(self) -> Bools:
        """Return whether each vertex is held in a symmetry plane across x, y or z, (n, 3)."""
        found = np.zeros(self._supports.fixed.shape, dtype=bool)
        for axis, at in self._supports.planes:
            found[:, axis] |= self._held(axis, at)
        return found

    def _held(self, axis: int, at: float) -> Bools:
        """Whether each vertex is fixed in a plane, and stays there."""
        supports, near = self._supports, FLAT * self._pattern.size
        rest = self._pattern.points[:, axis] - at
        moved = rest if supports.displacement is None else rest + supports.displacement[:, axis]
        return np.asarray(
            supports.fixed[:, axis] & (np.abs(rest) <= near) & (np.abs(moved) <= near)
        )
