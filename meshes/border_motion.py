"""Motion of a mesh with the borders of its print: lines grow or shrink, the triangles stay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import PatternError
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.snap import MovingMesh, least_angles
from toros_fem.meshes.triangles import edges_of

# A corner of a border moves by at most this multiple of the border's own way.
LONGEST = 2.0
# A spike whose normals sum up to less than this stays.
SHARP = 1e-3
# The direction of the polygon's border is taken where it is as close as this, over the square root
# of the mean area, and turned from that of the mesh by no more than this cosine says.
NEAR, ALIKE = 1.5, np.cos(np.radians(60.0))
# Angles may shrink to this fraction of what they were; where they would, the way is halved, so
# many times at most.
KEPT_ANGLE, HALVINGS = 0.4, 6


def border_motion(
    pattern: Pattern, regions: Sequence[BaseGeometry], printed: Bools, largest: float
) -> Floats:
    """Return by which flat points move where a print's borders move outwards by 1, (m, 2).

    Vertices between printed and plain triangles move along the normal of the border. Where a line
    ends at a seam or at the border of its panel they slide along it, both sides of a seam alike.
    The border of a panel is where the print is cut, and does not move. Corners of panels stay, and
    so do vertices where two lines touch.

    Args:
        pattern: The pattern, with edges that follow the polygons, by `snapped`.
        regions: Polygons on each panel, in m; they give the normals.
        printed: Whether each triangle is printed, (t,).
        largest: Largest way of the borders in m, to either side. Where it would flatten triangles,
            the motion is less.

    Raises:
        PatternError: The numbers of triangles differ.
    """
    if printed.shape != pattern.panel.shape:
        raise PatternError(
            f"printed has shape {printed.shape}; it must be {pattern.panel.shape}, one entry for "
            "each triangle."
        )
    mesh, flat, sewn = MovingMesh(pattern, regions), pattern.flat_points, pattern.sewn
    motion = np.zeros_like(flat)
    edges = edges_of(pattern.flat_triangles)
    sides = edges.sides[edges.inner]
    between = printed[sides[:, 0]] != printed[sides[:, 1]]
    ends, sides = edges.ends[edges.inner][between], sides[between]
    if not len(ends) or not mesh.any_border:
        return motion
    inside = np.where(printed[sides[:, 0]], sides[:, 0], sides[:, 1])
    way = np.diff(flat[ends], axis=1)[:, 0]
    normal = np.stack([way[:, 1], -way[:, 0]], axis=1) / np.linalg.norm(way, axis=1)[:, None]
    outwards = np.einsum("ij,ij->i", normal, flat[ends].mean(axis=1) - pattern.centroids[inside])
    normal *= np.sign(outwards)[:, None]
    count = np.bincount(ends.ravel(), minlength=len(flat))
    total = np.zeros_like(flat)
    np.add.at(total, ends.ravel(), np.repeat(normal, 2, axis=0))
    at_seam = ~mesh.inner[sewn]
    moves = np.flatnonzero(np.where(at_seam, (count == 1) & mesh.slides[sewn], count == 2))
    size = np.linalg.norm(total[moves], axis=1)
    moves, size = moves[size > SHARP], size[size > SHARP]
    along = total[moves] / size[:, None]
    # Of two unit normals with the sum s the corner moves by 2 s/|s|²: both edges move by 1.
    own = along * np.minimum(count[moves] / size, LONGEST)[:, None]
    direction, away = mesh.border_directions(moves)
    across = np.stack([direction[:, 1], -direction[:, 0]], axis=1)
    turned = np.einsum("ij,ij->i", across, along)
    across *= np.sign(turned)[:, None]
    length = float(np.sqrt(pattern.areas.mean()))
    smooth = (np.abs(turned) > ALIKE) & (away < NEAR * length)
    motion[moves] = np.where(smooth[:, None], across, own)
    _slide(pattern, mesh, moves[at_seam[moves]], motion)
    return motion * _allowed(pattern, motion, largest)[sewn][:, None]


def _slide(pattern: Pattern, mesh: MovingMesh, ends: Ints, motion: Floats) -> None:
    """Let the ends of borders slide along seams and along the borders of panels, in place."""
    flat, sewn, count = pattern.flat_points, pattern.sewn, len(pattern.points)
    point = np.flatnonzero(mesh.beside[:, 1] >= 0)
    along = np.zeros_like(flat)
    way = flat[mesh.beside[point, 1]] - flat[point]
    along[point] = way / np.linalg.norm(way, axis=1, keepdims=True)
    slope = np.einsum("ij,ij->i", motion[ends], along[ends])
    amount = np.clip(1 / np.where(slope == 0, np.inf, slope), -LONGEST, LONGEST)
    share = np.maximum(np.bincount(sewn[ends], minlength=count), 1)
    mean = np.bincount(sewn[ends], amount, minlength=count) / share
    both = np.isin(sewn, sewn[ends])
    motion[both] = mean[sewn[both], None] * along[both]


def _allowed(pattern: Pattern, motion: Floats, largest: float) -> Floats:
    """Return which fraction of its way each vertex may go, (n,), so that no triangle gets flat."""
    sewn, corner = pattern.sewn, pattern.flat_triangles
    least = KEPT_ANGLE * least_angles(pattern.corners)
    part = np.ones(len(pattern.points))
    for _ in range(HALVINGS):
        step = largest * part[sewn][:, None] * motion
        bad = np.zeros(len(corner), dtype=bool)
        for sign in (-1, 1):
            bad |= least_angles((pattern.flat_points + sign * step)[corner]) < least
        if not bad.any():
            return part
        part[np.unique(pattern.triangles[bad])] /= 2
    part[np.unique(pattern.triangles[bad])] = 0.0
    return part
