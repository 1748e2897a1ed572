"""Printed strips along centre lines: polygons that fit together at seams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.meshes.mirror import plane_border
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import half_edges, linked

# Nodes of a line that are nearer to each other than this fraction of its radius count once.
CLOSE = 0.1
# Corners of a round end.
AROUND = 32
# Relative excess of the radii of opening and closing, since round corners are polygons.
EXCESS = 0.015
# Polygons are simplified by at most this fraction of the print width.
SIMPLER = 0.004


@dataclass(frozen=True, eq=False)
class Strip:
    """A line with a width, as segments in the charts of their panels.

    Attributes:
        panel: Panel of each segment, (m,).
        points: Start and end of each segment, (m, 2, 2), in m; each starts on the skin where the
            one before ends.
        radii: Half the width at start and end, (m, 2), in m.
        beyond: Whether the strip runs on beyond its start and its end, where the panel ends.
    """

    panel: Ints
    points: Floats
    radii: Floats
    beyond: tuple[bool, bool]


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


def joints_of(pattern: Pattern, planes: tuple[int, ...]) -> list[Joint]:
    """Return the connected borders of all panels across which the skin goes on.

    Args:
        pattern: Any pattern.
        planes: Symmetry planes at which it is cut, as of `mirrored`.
    """
    flat = half_edges(pattern.flat_triangles)
    inner = pattern.edges.twins[pattern.edges.inner]
    sewn = np.any(flat[inner[:, 0]] != flat[inner[:, 1]][:, ::-1], axis=1)
    pairs = np.concatenate([inner[sewn], inner[sewn][:, ::-1]])
    cuts = [plane_border(pattern, axis) for axis in planes]
    cut = np.concatenate([*cuts, np.empty(0, np.int64)])
    here = np.concatenate([pairs[:, 0], cut])
    there = np.concatenate([pairs[:, 1], cut])
    mirror = np.arange(len(here)) >= len(pairs)
    target = pattern.flat_points[flat[here]]
    source = pattern.flat_points[flat[there]]
    source[~mirror] = source[~mirror][:, ::-1]
    turn = _turns(source, target, mirror)
    shift = target.mean(axis=1) - np.einsum("kij,kj->ki", turn, source.mean(axis=1))
    panel, other = pattern.panel[here // 3], pattern.panel[there // 3]
    # Connected edges of the source that lead to the same panel.
    joints = []
    for one, two in np.unique(np.stack([panel, other], axis=1), axis=0):
        part = np.flatnonzero((panel == one) & (other == two))
        ends = flat[there[part]]
        chain = linked(ends[:, 0], ends[:, 1], len(pattern.flat_points))[ends[:, 0]]
        for number in np.unique(chain):
            k = part[chain == number]
            joints.append(Joint(int(one), int(two), source[k], turn[k], shift[k]))
    return joints


def _turns(source: Floats, target: Floats, mirror: Bools) -> Floats:
    """Return matrices that turn edges (k, 2, 2) to others, or mirror in their line."""
    a, b = source[:, 1] - source[:, 0], target[:, 1] - target[:, 0]
    angle = np.arctan2(b[:, 1], b[:, 0]) - np.arctan2(a[:, 1], a[:, 0])
    double = 2 * np.arctan2(b[:, 1], b[:, 0])
    angle, sign = np.where(mirror, double, angle), np.where(mirror, -1.0, 1.0)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -sign * s], axis=1), np.stack([s, sign * c], axis=1)], axis=1)


def ribbons(
    strips: list[Strip], panel: int, joints: list[Joint], print_width: float
) -> list[BaseGeometry]:
    """Return the polygons of strips on a panel, and on a margin around it, in its chart.

    Args:
        strips: All strips of the skin.
        panel: Number of the panel.
        joints: All borders across which the skin goes on.
        print_width: Least width of lines and gaps in m.
    """
    if not strips:
        return []
    margin = max(float(strip.radii.max()) for strip in strips) + 3 * print_width
    polygons: list[BaseGeometry] = []
    for strip in strips:
        longer = _lengthened(strip, print_width)
        for run in _runs(longer.points, np.where(longer.panel == panel, 0, -1)):
            polygons += _ribbon(longer.points[run], longer.radii[run])
    for joint in joints:
        if joint.panel == panel:
            polygons += _across(strips, joint, margin, print_width)
    return polygons


def _across(
    strips: list[Strip], joint: Joint, margin: float, print_width: float
) -> list[BaseGeometry]:
    """Return the polygons near a joint of strips on its other side."""
    tree = shapely.STRtree(shapely.linestrings(joint.edges))
    same = np.round(np.column_stack([joint.turn.reshape(-1, 4), joint.shift]), 9)
    motion = np.unique(same, axis=0, return_inverse=True)[1].ravel()
    polygons: list[BaseGeometry] = []
    for strip in strips:
        longer = _lengthened(strip, print_width)
        number = np.full(len(longer.panel), -1)
        here = np.flatnonzero(longer.panel == joint.source)
        if not len(here):
            continue
        lines = shapely.linestrings(longer.points[here])
        near, edge = tree.query_nearest(lines, max_distance=margin, all_matches=False)
        # The motion of the edge next to the segment's middle.
        middle = shapely.points(longer.points[here[near]].mean(axis=1))
        edge = tree.query_nearest(middle, all_matches=False)[1]
        number[here[near]] = edge
        label = np.where(number >= 0, motion[number], -1)
        for run in _runs(longer.points, label):
            k = number[run[0]]
            moved = longer.points[run] @ joint.turn[k].T + joint.shift[k]
            polygons += _ribbon(moved, longer.radii[run])
    return polygons


def _lengthened(strip: Strip, print_width: float) -> Strip:
    """Return the strip run on straight where it leaves its panel."""
    points, radii, panel = strip.points, strip.radii, strip.panel
    for side in range(2):
        if not strip.beyond[side]:
            continue
        k = 0 if side == 0 else len(points) - 1
        way = points[k, side] - points[k, 1 - side]
        length = np.hypot(*way)
        if length == 0:
            continue
        radius = radii[k, side]
        end = points[k, side] + way / length * (4 * radius + 2 * print_width)
        ends = [end, points[k, side]] if side == 0 else [points[k, side], end]
        at = 0 if side == 0 else len(points)
        points = np.insert(points, at, np.array(ends), axis=0)
        radii = np.insert(radii, at, [radius, radius], axis=0)
        panel = np.insert(panel, at, panel[k])
    return Strip(panel, points, radii, (False, False))


def _runs(points: Floats, label: Ints) -> list[Ints]:
    """Return runs of segments that follow each other in one chart, with equal labels of 0 or more.

    A line that crosses a seam may stay on its panel, but goes on at another place of it.
    """
    away = np.abs(points[1:, 0] - points[:-1, 1]).max(axis=1) > 1e-9
    begin = 1 + np.flatnonzero(away | (label[1:] != label[:-1]))
    runs = np.split(np.arange(len(label)), begin)
    return [run for run in runs if label[run[0]] >= 0]


def _ribbon(points: Floats, radii: Floats) -> list[BaseGeometry]:
    """Return polygons whose union is a strip of varying width with round ends.

    Args:
        points: Start and end of consecutive segments in one chart, (m, 2, 2), in m.
        radii: Half the width at both, (m, 2), in m.
    """
    node = np.concatenate([points[:, 0], points[-1:, 1]])
    radius = np.concatenate([radii[:, 0], radii[-1:, 1]])
    kept = _apart(node, CLOSE * radius)
    return _strip(node[kept], radius[kept])


def _apart(node: Floats, least: Floats) -> Ints:
    """Return the first node, the last one, and those between that are not too near to others."""
    kept = [0]
    for k in range(1, len(node) - 1):
        if min(np.hypot(*(node[k] - node[other])) for other in (kept[-1], -1)) > least[k]:
            kept.append(k)
    if len(node) > 2 or np.any(node[-1] != node[0]):
        kept.append(len(node) - 1)
    return np.array(kept)


def _strip(node: Floats, radius: Floats) -> list[BaseGeometry]:
    """Return polygons for nodes (n, 2) and half the width at each, (n,)."""
    ends = [
        shapely.Point(node[k]).buffer(radius[k], quad_segs=AROUND // 4) for k in (0, len(node) - 1)
    ]
    if len(node) < 2:
        return ends[:1]
    way = np.diff(node, axis=0)
    way /= np.hypot(*way.T)[:, None]
    normal = np.stack([-way[:, 1], way[:, 0]], axis=1)
    mean = np.concatenate([normal[:1], normal[:-1] + normal[1:], normal[-1:]])
    # The mitre: its offset from both segments is the radius.
    scale = np.einsum("ij,ij->i", mean, np.concatenate([normal[:1], normal]))
    sharp = scale <= 0.5 * np.linalg.norm(mean, axis=1)
    offset = mean / np.where(sharp, 1.0, scale)[:, None] * radius[:, None]
    whole = shapely.Polygon(np.concatenate([node + offset, (node - offset)[::-1]]))
    if len(node) == 2 or (not sharp.any() and whole.is_valid):
        return [whole, *ends]
    # It overlaps itself: in two parts, whose round ends join them.
    middle = len(node) // 2
    return _strip(node[: middle + 1], radius[: middle + 1]) + _strip(node[middle:], radius[middle:])


def cleaned(region: BaseGeometry, print_width: float, hole_area: float) -> BaseGeometry:
    """Return a region without lines, gaps, holes and pieces that are too small to print.

    Args:
        region: Polygons in m.
        print_width: Least width of lines and gaps in m.
        hole_area: Least area of a hole or of a piece in m².
    """
    radius = (1 + EXCESS) * print_width / 2
    for sign in (1, -1):
        region = _offset(_offset(region, sign * radius), -sign * radius)
    polygons = [part for part in shapely.get_parts(region) if part.area >= hole_area]
    filled = []
    for polygon in polygons:
        rings = [r for r in polygon.interiors if shapely.Polygon(r).area >= hole_area]
        filled.append(shapely.Polygon(polygon.exterior, rings))
    return shapely.unary_union(filled).simplify(SIMPLER * print_width, preserve_topology=False)


def _offset(region: BaseGeometry, distance: float) -> BaseGeometry:
    return region.buffer(distance, quad_segs=8)
