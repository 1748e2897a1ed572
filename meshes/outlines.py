"""Skins of two equal flat panels, sewn along an outline: a walker, a finger, a gripper.

The paper shows the walker (Figs. 9, 10) and the gripper (Fig. 1) without sizes: all sizes are ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from mpi4py import MPI
from scipy.spatial import cKDTree
from shapely.geometry import LineString, Polygon, box
from shapely.geometry.polygon import orient

from toros_fem.base.errors import OutlineError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    Bools,
    Floats,
    Ints,
    checked_axes,
    checked_floats,
    checked_list,
    is_number,
    require_between,
    require_count,
    require_finite,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheets import polygon_mesh
from toros_fem.meshes.triangles import (
    coincident,
    cross,
    edges_of,
    flat_areas,
    laplacian,
    require_affordable,
    spd_factor,
)

TOP, BOTTOM = "top", "bottom"
# Root mean square slope of the pillow. The mean strain of the assembled panels is half its square.
SLOPE = 0.02
Line = tuple[tuple[float, float], tuple[float, float]]
# Lengths below this fraction of the outline's size count as 0.
TINY = 1e-9
# A point where the outline turns by more than this, in rad, is a corner. Others are on a curve.
CORNER = np.radians(20.0)
# Largest angle in rad between neighbouring points of an arc.
ARC_STEP = np.radians(5.0)


@on_root
def two_panels(
    comm: MPI.Comm,
    outline: npt.ArrayLike,
    edge_length: float,
    *,
    lines: Sequence[Line] = (),
    planes: Sequence[int] = (),
) -> Pattern:
    """Make two equal panels, "top" and "bottom", sewn along an outline (collective).

    Both have the same mesh, so that they fit vertex by vertex. The assembled skin lies in the plane
    z = 0, apart from a slight pillow with the top at z > 0, which defines the inside.
    The stress-free shape is flat. The first two coordinates of `Pattern.points` are the place in
    the outline on either panel. The flat coordinates of the bottom are mirrored, (x, −y).

    Args:
        outline: Points (k, 2) in m of the whole closed outline: corners, and points on arcs. A
            point where it turns by more than 20° is a corner. Between corners it is divided evenly.
        lines: Straight lines from border to border of the whole outline, ((x, y), (x, y)) in m,
            along which both panels get mesh edges.
        planes: Symmetry planes that cut the skin: 0 keeps x ≥ 0, 1 keeps y ≥ 0. The cut is not
            sewn: `symmetry_plane` supports it, `mirrored` completes the skin.

    Raises:
        OutlineError: The outline crosses itself, is not symmetric, or does not fit its lines or
            the edge length.
    """
    lines = checked_list("lines", lines, object, "lines, () for none", OutlineError)
    planes = checked_axes("planes", planes, (0, 1), OutlineError)
    flat, triangles, seam = region_mesh(outline, edge_length, lines, planes)
    count = len(flat)
    height = _pillow(flat, triangles, seam)
    above, below = (np.column_stack([flat, sign * height]) for sign in (1, -1))
    other = np.where(seam, np.arange(count), count + np.cumsum(~seam) - 1)
    return Pattern(
        flat_points=np.concatenate([flat, flat * [1, -1]]),
        flat_triangles=np.concatenate([triangles, count + triangles[:, ::-1]]),
        panel=np.repeat([0, 1], len(triangles)),
        sewn=np.concatenate([np.arange(count), other]),
        points=np.concatenate([above, below[~seam]]),
        panel_names=(TOP, BOTTOM),
    )


def plane_centroids(pattern: Pattern) -> Floats:
    """Return the place of each triangle in the outline, (t, 2), in m, the same on both panels.

    `Pattern.centroids` are in each panel's own coordinates, which are mirrored on the bottom.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    return pattern.points[pattern.triangles, :2].mean(axis=1)


def _pillow(flat: Floats, triangles: Ints, seam: Bools) -> Floats:
    """Return heights (m,) of a membrane under pressure, −Δu = 1, fixed at the seam only."""
    stiffness, area = laplacian(flat[triangles], triangles), flat_areas(flat[triangles])
    load = np.bincount(triangles.ravel(), np.repeat(area / 3, 3))
    height = np.zeros(len(flat))
    height[~seam] = spd_factor(stiffness[~seam][:, ~seam]).solve(load[~seam])
    # ∫ |∇u|² = ∫ u hardly depends on the mesh. The steepest slope, at inner corners, would.
    return np.asarray(SLOPE * height / np.sqrt(load @ height / area.sum()))


@dataclass(frozen=True)
class Star:
    """A round body with equal arms that end in half circles.

    Attributes:
        arms: Number of arms, at least 2.
        arm_length: Length of an arm from the body's circle to the tip, in m.
        arm_width, body_radius: Width of an arm and radius of the body in m.
        corner_radius: Radius of the fillets between arm and body, or between two arms, in m.
        angle: Angle from the x axis to the first arm, in rad.
    """

    arms: int
    arm_length: float
    arm_width: float
    body_radius: float
    corner_radius: float
    angle: float = 0.0

    def __post_init__(self) -> None:
        require_count(2, arms=self.arms)
        names = ("arm_length", "arm_width", "body_radius", "corner_radius")
        require_positive(**{name: getattr(self, name) for name in names})
        require_finite(angle=self.angle)
        if self.arm_width > 2 * self.body_radius:
            raise OutlineError(
                f"arm_width = {self.arm_width} m must be at most the body's diameter, twice "
                f"body_radius = {self.body_radius:.6g} m."
            )
        room = self.reach - self.arm_width / 2 - self.root
        if room <= 0:
            raise OutlineError(
                f"arm_length = {self.arm_length} m must exceed {self.arm_length - room:.6g} m, "
                "where the fillet ends and the round tip begins. Lengthen the arms, or lower "
                "corner_radius or arm_width."
            )

    @property
    def reach(self) -> float:
        """Distance of the tips from the centre in m."""
        return self.body_radius + self.arm_length

    @property
    def root(self) -> float:
        """Distance from the centre in m beyond which the arms have their width."""
        return float(self._fillet[0])

    @property
    def directions(self) -> Floats:
        """Unit vectors along the arms, (arms, 2), counter-clockwise."""
        angle = self.angle + 2 * np.pi * np.arange(self.arms) / self.arms
        return np.column_stack([np.cos(angle), np.sin(angle)])

    @property
    def roots(self) -> tuple[Line, ...]:
        """Lines across the arms at their roots, in m."""
        aside = self.directions[:, ::-1] * [-1, 1] * (self.arm_width / 2)
        middle = self.root * self.directions
        ends: Any = np.concatenate([middle - aside, middle + aside], axis=1).tolist()
        return tuple(((a, b), (c, d)) for a, b, c, d in ends)

    @property
    def outline(self) -> Floats:
        """Points of the outline, (k, 2), in m, counter-clockwise."""
        half, step, centre = self.arm_width / 2, np.pi / self.arms, self._fillet
        tip = arc([self.reach - half, 0], half, 0, np.pi / 2)
        # The body's circle and the fillet touch on the line between their centres.
        touch = np.arctan2(centre[1], centre[0])
        fillet = arc(centre, self.corner_radius, -np.pi / 2, min(touch, step) - np.pi)
        body = arc([0, 0], self.body_radius, touch, step)[1:] if touch < step else fillet[:0]
        upper = np.concatenate([tip, fillet, body])
        # The last point is on the border to the next sector, the first on the arm's axis.
        sector = np.concatenate([upper[:0:-1] * [1, -1], upper])[1:]
        left = self.directions[:, ::-1] * [-1, 1]
        turned = sector[:, 0, None] * self.directions[:, None] + sector[:, 1, None] * left[:, None]
        return turned.reshape(-1, 2)

    @property
    def _fillet(self) -> Floats:
        """Centre of the fillet on the left of an arm along x, (2,), in m."""
        aside = self.arm_width / 2 + self.corner_radius
        out = np.sqrt((self.body_radius + self.corner_radius) ** 2 - aside**2)
        # Where the arms meet before they reach the body, the fillet touches both.
        return np.array([max(out, aside / np.tan(np.pi / self.arms)), aside])


# Four arms, as the walker of the paper has them, Figs. 9 and 10.
WALKER = Star(4, 0.06, 0.024, 0.02, 6e-3, np.pi / 4)


# Three fingers, as the gripper of the paper has them, Fig. 1.
GRIPPER = Star(3, 0.09, 0.025, 0.025, 6e-3)


def walker(
    comm: MPI.Comm, edge_length: float, star: Star = WALKER, *, planes: Sequence[int] = ()
) -> Pattern:
    """Make a body with legs, by default four along the diagonals (paper Figs. 9, 10).

    Mesh edges separate body and legs: a triangle with the `plane_centroids` c belongs to leg k
    where c · star.directions[k] > star.root. Planes are () for the whole, (0,) or (1,) for half of
    it, (0, 1) for a quarter with one leg.
    """
    require_kind("star", star, Star, "a Star")
    return two_panels(comm, star.outline, edge_length, lines=star.roots, planes=planes)


def gripper(
    comm: MPI.Comm, edge_length: float, star: Star = GRIPPER, *, planes: Sequence[int] = ()
) -> Pattern:
    """Make a palm with fingers, by default three at 120° (paper Fig. 1), the first along +x.

    Arguments are those of `walker`; planes: () for the whole, (1,) for the half at y ≥ 0.
    """
    return walker(comm, edge_length, star, planes=planes)


def finger(
    comm: MPI.Comm,
    edge_length: float,
    *,
    length: float = 0.09,
    width: float = 0.025,
    root: float = 0.015,
    corner_radius: float = 4e-3,
    planes: Sequence[int] = (),
) -> Pattern:
    """Make a straight finger along +x from x = 0, sewn all around, with a half circle as its tip.

    The sizes, in m, are ours: the paper gives none. `root` is the length of the part that a mount
    holds; a line of mesh edges ends it. The corner radius is that of the two corners at x = 0.
    Planes are () for the whole, (1,) for the half at y ≥ 0.
    """
    require_positive(length=length, width=width, root=root, corner_radius=corner_radius)
    half = width / 2
    if not corner_radius < root < length - half:
        raise OutlineError(
            f"root = {root} m must lie between the corners' arcs and the round tip, "
            f"{corner_radius:.6g} to {length - half:.6g} m."
        )
    corners = [(0.0, -half), (length, -half), (length, half), (0.0, half)]
    outline = rounded(corners, (corner_radius, half, half, corner_radius))
    line = ((root, -half), (root, half))
    return two_panels(comm, outline, edge_length, lines=[line], planes=planes)


# --------------------------------------------------------------------------------------- outlines


def arc(centre: npt.ArrayLike, radius: float, begin: float, end: float) -> Floats:
    """Return points on an arc, (k, 2), in m, from one angle in rad to another, with both ends."""
    steps = max(1, int(np.ceil(abs(end - begin) / ARC_STEP)))
    angle = np.linspace(begin, end, steps + 1)
    return np.asarray(centre) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def rounded(corners: npt.ArrayLike, radius: float | Sequence[float]) -> Floats:
    """Round the corners of a polygon, (k, 2) in m, by arcs that are tangent to both sides.

    There is one radius in m for all arcs, or one for each corner; 0 leaves a corner sharp. Returned
    are points (m, 2) in m, on arcs at most 5° apart.

    Raises:
        OutlineError: A radius is too large for the sides at its corner.
    """
    points = _checked(corners)
    count = (len(points),)
    what = f"one in m for all corners, or one for each of {len(points)}"
    given = checked_floats("radius", radius, what, lambda s: s in ((), count), failure=OutlineError)
    radii = np.broadcast_to(given, count)
    require_between(0.0, np.inf, **{f"radius[{k}]": value for k, value in enumerate(radii)})
    after = np.roll(points, -1, axis=0) - points
    side, turn = np.linalg.norm(after, axis=1), _turns(points)
    cut = radii * np.tan(np.abs(turn) / 2)  # length that an arc takes from each side
    room = side - cut - np.roll(cut, -1)
    if np.any(room < -TINY * side):
        k = int(np.argmin(room / side))
        other = (k + 1) % len(points)
        fraction = side[k] / (cut[k] + cut[other])
        raise OutlineError(
            f"the arcs of radius {radii[k]:.6g} and {radii[other]:.6g} m at corners {k} and "
            f"{other} take {cut[k] + cut[other]:.6g} m of a side of {side[k]:.6g} m. Radii at "
            f"most {fraction:.3g} times as large fit."
        )
    into = np.roll(after / side[:, None], 1, axis=0)
    left = np.sign(turn)[:, None] * into[:, ::-1] * [-1, 1]
    centre = points - cut[:, None] * into + radii[:, None] * left
    angle = np.arctan2(-left[:, 1], -left[:, 0])
    parts = [
        arc(centre[k], radii[k], angle[k], angle[k] + turn[k]) if cut[k] else points[k : k + 1]
        for k in range(len(points))
    ]
    return np.concatenate(parts)


def region_mesh(
    outline: npt.ArrayLike, edge_length: float, lines: Sequence[Line], planes: Sequence[int]
) -> tuple[Floats, Ints, Bools]:
    """Mesh the inside of an outline, or the part of it at positive coordinates (one rank).

    Between corners, ends of lines and cuts the border is divided evenly; a curve becomes the
    polygon through its divisions. Arguments are those of `two_panels`. Returned are points (m, 2)
    in m, counter-clockwise triangles (t, 3), and whether each point is on the outline, (m,). Other
    points of the border are on a cut, where a coordinate is exactly 0.
    """
    whole = Polygon(_checked(outline))
    if not whole.is_valid:
        why = shapely.is_valid_reason(whole)
        raise OutlineError(f"the outline is no simple closed curve: {why}. Correct it there.")
    size = float(np.hypot(*np.ptp(whole.exterior.coords, axis=0)))
    bound = 2 * whole.area / whole.length
    if not (is_number(edge_length) and 0 < edge_length <= bound):
        raise OutlineError(
            f"edge_length = {shown(edge_length)} m must be greater than 0 and at most {bound:.4g} "
            "m, twice the area over the border's length: the outline is no wider."
        )
    require_affordable(whole.area / 2 ** len(planes), edge_length)
    cuts = [_line_across(whole, k, line, size) for k, line in enumerate(lines)]
    faces = _faces(_part(whole, planes, size), cuts, planes, size)
    for face in faces:
        if face.area < edge_length**2 / 4:
            raise OutlineError(
                f"the lines leave a face of {face.area:.3g} m² at ({face.centroid.x:.4g}, "
                f"{face.centroid.y:.4g}) m; the least for this edge length is "
                f"{edge_length**2 / 4:.3g} m². Move the lines, or shorten the edges."
            )
    rings = _divided(faces, edge_length)
    if not all(Polygon(ring).is_valid for ring in rings):
        raise OutlineError(
            f"edge_length = {edge_length} m is too long for the outline: its border crosses "
            "itself when it is divided evenly. Shorten the edges."
        )
    # Faces share the points on lines between them.
    place = coincident(np.concatenate(rings), 1e-3 * edge_length)
    corners = np.concatenate(rings)[np.unique(place, return_index=True)[1]]
    numbers = np.split(place, np.cumsum([len(ring) for ring in rings])[:-1])
    flat, triangles = polygon_mesh(corners, edge_length, faces=numbers)
    _snap(flat, planes, size)
    edges = edges_of(triangles)
    border = edges.ends[edges.border]
    sewn = np.zeros(len(flat), dtype=bool)
    sewn[border[~_in_planes(flat, border, planes)]] = True
    return without_bridges(flat, triangles, sewn, planes)


def _checked(points: npt.ArrayLike) -> Floats:
    """Return the different points of an outline, (k, 2)."""
    found = checked_floats(
        "outline", points, "at least 3 points (k, 2) in m",
        lambda shape: len(shape) == 2 and shape[0] > 2 and shape[1] == 2, failure=OutlineError,
    )  # fmt: skip
    gap = np.linalg.norm(found - np.roll(found, 1, axis=0), axis=1)
    found = found[gap > TINY * np.hypot(*np.ptp(found, axis=0))]
    if len(found) < 3:
        raise OutlineError(f"the outline has {len(found)} different points; it needs at least 3.")
    return found


def _turns(points: Floats) -> Floats:
    """Return the angle in rad by which a closed line (k, 2) turns at each point, (k,)."""
    into, out = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    return np.arctan2(cross(into, out), (into * out).sum(axis=1))


def _part(whole: Polygon, planes: Sequence[int], size: float) -> Polygon:
    """Return the part of the region at positive coordinates."""
    part = whole
    for axis in planes:
        flip = np.where(np.arange(2) == axis, -1, 1)
        image = shapely.transform(whole, lambda points, flip=flip: points * flip)
        apart = whole.symmetric_difference(image).area / whole.area
        if apart > 1e-6:
            raise OutlineError(
                f"the outline and its mirror image in {'xy'[axis]} = 0 differ by {apart:.2g} of "
                "its area; they must be equal. Centre the outline, or leave the plane out."
            )
        low, high = np.reshape(whole.bounds, (2, 2)) + [[-size], [size]]
        low[axis] = 0.0
        part = _snapped(part.intersection(box(*low, *high)), [axis], size)
    if part.geom_type != "Polygon":
        raise OutlineError("the symmetry planes divide the outline into several parts; omit one.")
    return orient(part)


def _snap(points: Floats, planes: Sequence[int], size: float) -> Floats:
    """Put points near planes exactly into them, in place."""
    for axis in planes:
        points[np.abs(points[:, axis]) < TINY * size, axis] = 0.0
    return points


def _snapped(shape: shapely.Geometry, planes: Sequence[int], size: float) -> shapely.Geometry:
    return shapely.transform(shape, lambda points: _snap(points.copy(), planes, size))


def _line_across(whole: Polygon, number: int, line: Line, size: float) -> LineString:
    """Return a line extended a little beyond the outline, so that rounding cannot shorten it."""
    what = "two points ((x, y), (x, y)) in m"
    ends = checked_floats(f"line {number}", line, what, (2, 2), failure=OutlineError)
    along = ends[1] - ends[0]
    along *= 1e-6 * size / max(float(np.hypot(*along)), 1e-6 * size)
    found = LineString([ends[0] - along, ends[1] + along])
    inside = [end for end in found.coords if whole.contains(shapely.Point(end))]
    if inside or not found.intersects(whole):
        what = f"ends inside the outline at {inside[0]}" if inside else "misses the outline"
        raise OutlineError(f"line {number} {what}; it must cross it from border to border.")
    return found


def _faces(
    part: Polygon, cuts: Sequence[LineString], planes: Sequence[int], size: float
) -> list[Polygon]:
    """Return the faces into which lines divide a region."""
    if not cuts:
        return [part]
    work = shapely.union_all([part.exterior, *(_snapped(cut, planes, size) for cut in cuts)])
    found = shapely.get_parts(shapely.polygonize(shapely.get_parts(work)))
    inside = [orient(face) for face in found if part.contains(face.representative_point())]
    middles = np.array([[face.centroid.x, face.centroid.y] for face in inside])
    return [inside[k] for k in np.lexsort(np.round(middles / size, 6).T[::-1])]


def _divided(faces: Sequence[Polygon], edge_length: float) -> list[Floats]:
    """Return the borders of faces, (k, 2), divided evenly between points that must be vertices.

    These are corners, ends of lines, and their crossings.
    """
    rings = [_checked(np.asarray(face.exterior.coords)[:-1]) for face in faces]
    corners = np.concatenate([points[np.abs(_turns(points)) > CORNER] for points in rings])
    stops = cKDTree(corners if len(corners) else rings[0][:1])
    found = []
    for points in rings:
        near = 10 * TINY * np.hypot(*np.ptp(points, axis=0))
        first = np.flatnonzero(stops.query(points)[0] < near)
        first = first if len(first) else np.array([0])
        points = np.roll(points, -first[0], axis=0)
        closed = np.concatenate([points, points[:1]])
        least, parts = {1: 4, 2: 2}.get(len(first), 1), []
        for begin, end in pairwise(np.append(first - first[0], len(points))):
            piece = closed[begin : end + 1]
            reach = np.append(0.0, np.cumsum(np.hypot(*np.diff(piece, axis=0).T)))
            count = max(least, round(reach[-1] / edge_length))
            at = np.linspace(0, reach[-1], count + 1)[:-1]
            parts.append(np.column_stack([np.interp(at, reach, x) for x in piece.T]))
        found.append(np.concatenate(parts))
    return found


def _in_planes(flat: Floats, ends: Ints, planes: Sequence[int]) -> Bools:
    """Return whether each edge is in a plane, (e,)."""
    return np.asarray((flat[ends][:, :, list(planes)] == 0).all(axis=1).any(axis=1))


def without_bridges(
    flat: Floats, triangles: Ints, sewn: Bools, planes: Sequence[int]
) -> tuple[Floats, Ints, Bools]:
    """Halve every edge, inside or along a cut, whose two ends are on the outline.

    Both panels would have this edge between the same sewn vertices: inside, four triangles would
    meet there; at a cut, the skin would be closed there.
    """
    while True:
        edges = edges_of(triangles)
        inside = (edges.count == 2) | _in_planes(flat, edges.ends, planes)
        bridges = edges.ends[inside & sewn[edges.ends].all(axis=1)]
        if len(bridges) == 0:
            return flat, triangles, sewn
        ends = bridges[0]
        middle = len(flat)
        flat = np.concatenate([flat, flat[ends].mean(axis=0)[None]])
        sewn = np.append(sewn, False)
        beside = np.flatnonzero(np.isin(triangles, ends).sum(axis=1) == 2)
        halves = [np.where(triangles[beside] == end, middle, triangles[beside]) for end in ends]
        triangles = np.concatenate([np.delete(triangles, beside, axis=0), *halves])
