"""Printed ribbons along lines: polygons that fit together across seams and symmetry planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.mirror import plane_border
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import half_edges, linked

# Corners of a round end.
AROUND = 32
# Relative excess of the radii of opening and closing, since round corners are polygons.
EXCESS = 0.015
# Polygons are simplified by at most this fraction of the print width.
SIMPLER = 0.004


def capsules(points: Floats, radii: Floats) -> np.ndarray:
    """Return polygons around segments (m, 2, 2) with round ends of given radii (m, 2), (m,)."""
    way = points[:, 1] - points[:, 0]
    length = np.hypot(*way.T)[:, None]
    way = np.divide(way, length, out=np.tile([1.0, 0.0], (len(way), 1)), where=length > 0)
    left = np.stack([-way[:, 1], way[:, 0]], axis=1)[:, None]
    angle = np.linspace(0, np.pi, AROUND // 2 + 1)[:, None]
    around = left * np.cos(angle) - way[:, None] * np.sin(angle)  # from the left to the right
    middles, radius = points[:, :, None], radii[:, :, None, None]
    ends = middles + radius * np.stack([around, -around], axis=1)
    return np.asarray(shapely.polygons(ends.reshape(-1, AROUND + 2, 2)))


@dataclass(frozen=True, eq=False)
class Joint:
    """A border of a panel across which the skin goes on: a seam, or a cut in a symmetry plane.

    Attributes:
        panel: Panel that gets a margin.
        source: Panel whose flat chart is moved to the other's.
        edges: Edges of the source along the border, (k, 2, 2), in m.
        turn: Orthogonal matrix of the motion, (k, 2, 2).
        shift: Translation of the motion, (k, 2), in m.
    """

    panel: int
    source: int
    edges: Floats
    turn: Floats
    shift: Floats

    def across(self, segments: Floats, margin: float) -> tuple[Ints, Floats]:
        """Return which segments (m, 2, 2) of the source are nearer than a margin, and them moved.

        The edge next to a segment's middle moves it.
        """
        tree = shapely.STRtree(shapely.linestrings(self.edges))
        near = tree.query(shapely.linestrings(segments), predicate="dwithin", distance=margin)[0]
        near = np.unique(near)
        middle = shapely.points(segments[near].mean(axis=1))
        edge = tree.query_nearest(middle, all_matches=False)[1]
        moved = np.einsum("kij,kej->kei", self.turn[edge], segments[near])
        return near, moved + self.shift[edge, None]


def joints_of(pattern: Pattern, planes: tuple[int, ...]) -> list[Joint]:
    """Return the connected borders of all panels at seams, and at planes, as of `mirrored`."""
    flat = half_edges(pattern.flat_triangles)
    inner = pattern.edges.twins[pattern.edges.inner]
    sewn = inner[np.any(flat[inner[:, 0]] != flat[inner[:, 1]][:, ::-1], axis=1)]
    cut = np.concatenate([np.empty(0, np.int64), *(plane_border(pattern, k) for k in planes)])
    here = np.concatenate([*sewn.T, cut])
    there = np.concatenate([*sewn.T[::-1], cut])
    sign = np.where(np.arange(len(here)) < 2 * len(sewn), 1.0, -1.0)
    target, source = pattern.flat_points[flat[here]], pattern.flat_points[flat[there]]
    source[sign > 0] = source[sign > 0][:, ::-1]
    # Turned to the target, or mirrored in its line.
    a, b = (np.arctan2(*(ends[:, 1] - ends[:, 0]).T[::-1]) for ends in (source, target))
    angle = b - sign * a
    c, s = np.cos(angle), np.sin(angle)
    turn = np.stack([c, -sign * s, s, sign * c], axis=1).reshape(-1, 2, 2)
    shift = target.mean(axis=1) - np.einsum("kij,kj->ki", turn, source.mean(axis=1))
    # Connected edges of the source that lead to the same panel.
    size = len(pattern.flat_points)
    panel, other = pattern.panel[here // 3], pattern.panel[there // 3]
    joints = []
    for one, two in np.unique(np.stack([panel, other], axis=1), axis=0):
        part = np.flatnonzero((panel == one) & (other == two))
        begin, end = flat[there[part]].T
        chain = linked(begin, end, size)[begin]
        joints += [
            Joint(int(one), int(two), source[k], turn[k], shift[k])
            for k in (part[chain == number] for number in np.unique(chain))
        ]
    return joints


def straight_joints(pattern: Pattern) -> list[Joint]:
    """Return the seams at which one rigid motion leads from a flat chart to the other."""
    near = 1e-6 * pattern.size
    return [
        joint
        for joint in joints_of(pattern, ())
        if np.ptp(joint.turn, axis=0).max() < 1e-6 and np.ptp(joint.shift, axis=0).max() < near
    ]


def ribbons(
    panel: Ints, points: Floats, radii: Floats, joints: list[Joint], margin: float, panels: int
) -> list[BaseGeometry]:
    """Return the region of each panel, and of a margin in m around it, under lines with a width.

    They are segments (m, 2, 2) in the charts of their panels (m,), with half the width at start
    and end, (m, 2), in m.
    """
    parts = [(panel, points, radii)]
    for joint in joints:
        there = np.flatnonzero(panel == joint.source)
        near, moved = joint.across(points[there], margin)
        parts.append((np.full(len(near), joint.panel), moved, radii[there[near]]))
    panel, points, radii = (np.concatenate(part) for part in zip(*parts, strict=True))
    capsule = capsules(points, radii)
    return [shapely.union_all(capsule[panel == k]) for k in range(panels)]


def kept_width(print_width: float) -> float:
    """Return the least width in m of lines and gaps that `cleaned` keeps."""
    return (1 + 2 * EXCESS) * print_width


def cleaned(region: BaseGeometry, print_width: float, hole_area: float) -> BaseGeometry:
    """Return a region without lines and gaps, in m, holes and pieces, in m², that are too small."""
    radius = (1 + EXCESS) * print_width / 2
    for distance in (radius, -radius, -radius, radius):
        region = region.buffer(distance, quad_segs=8)
    kept = [
        shapely.Polygon(
            part.exterior, [r for r in part.interiors if shapely.Polygon(r).area >= hole_area]
        )
        for part in shapely.get_parts(region)
        if part.area >= hole_area
    ]
    return shapely.union_all(kept).simplify(SIMPLER * print_width, preserve_topology=False)
