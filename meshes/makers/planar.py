"""Regions of the plane: rounded corners, cuts at symmetry planes, meshes with given lines."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import cKDTree
from shapely.geometry import LineString, Polygon, box
from shapely.geometry.polygon import orient

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import OutlineError
from toros_fem.base.validation import checked_floats, is_number, require_between, shown
from toros_fem.meshes.makers.flat import polygon_mesh
from toros_fem.meshes.triangles import coincident, cross, edges_of, require_affordable

Line = tuple[tuple[float, float], tuple[float, float]]

# Lengths below this fraction of the outline's size count as 0.
TINY = 1e-9
# A point where the outline turns by more than this, in rad, is a corner. Others are on a curve.
CORNER = np.radians(20.0)
# Largest angle in rad between neighbouring points of an arc.
ARC_STEP = np.radians(5.0)


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
