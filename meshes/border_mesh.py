"""Meshes whose edges are the borders of regions: each triangle lies in one of them or in none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import PatternError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import Bools, Floats, Ints, require_positive
from toros_fem.meshes.panels import (
    faces_mesh,
    located,
    places_on,
    polygons_of,
    runs_of_ring,
    straight_on,
)
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import OtherMesh
from toros_fem.meshes.triangles import edge_keys, edges_of, equilateral_edge, require_affordable

# Edges of a border are as long as the print is wide, in the mean, and at most this fraction of
# those of the plain fabric.
FINER = 0.5
# A border may be off by this fraction of the mean width, and of the edges of the fabric.
OFF_WIDTH, OFF_EDGE = 0.05, 0.035
# Ends of borders on an outline that are closer than this fraction of the fabric's edges, and of
# the mean width, meet in one vertex: those from both sides of a seam above all.
JOINED, JOINED_WIDTH = 0.06, 0.25
# Gaps and print that are thinner than what joins are left out; this fraction of it is rounding.
ROUNDING = 1e-3
# Polygons are computed on a grid of this fraction of it, without cracks between them.
GRID = 1e-6
# Points closer than this fraction of the skin's size to an outline lie on it.
ON_OUTLINE = 1e-7
# A piece of an outline or border may be longer by this fraction than its edge length.
LONGER = 0.25
# How often a border that meets another one is simplified by half as much.
HALVINGS = 6
# Least number of vertices along a closed outline without a corner, the first one counted twice.
LOOP = 4
# Steps of the search for the shift that restores an area.
SHIFTS = 20


class _Sizes(NamedTuple):
    """Edge lengths of fabric and borders, allowed error of borders, and what joins, in m."""

    fabric: float
    border: float
    off: float
    joined: float


@dataclass(frozen=True, eq=False)
class _Chain:
    """Edges of outlines between two vertices where something turns or meets.

    Attributes:
        vertices: Assembled vertices of the pattern along it, (k,).
        sides: Flat points of the pattern along it on each panel that it borders, one or two of
            (k,).
        reach: Distance of each of them from the first one, along the first side, (k,), in m.
        place: Such distances of the new vertices, (m,).
        flat: Flat places of the new vertices on each side, (m, 2).
    """

    vertices: Ints
    sides: list[Ints]
    reach: Floats
    place: Floats
    flat: list[Floats]

    def at(self, pattern: Pattern, side: Ints, place: Floats) -> Floats:
        """Return flat places on a side at distances along the chain, (n, 2)."""
        corners = pattern.flat_points[side]
        found = np.stack([np.interp(place, self.reach, x) for x in corners.T], axis=1)
        # Vertices that stay are exactly where they were.
        found[place == self.reach[0]], found[place == self.reach[-1]] = corners[0], corners[-1]
        return found


@dataclass(frozen=True, eq=False)
class _Curve:
    """A border inside a panel: points, (k, 2); an open one ends on the outline."""

    panel: int
    points: Floats
    closed: bool


@on_root
def bordered(
    comm: MPI.Comm,
    pattern: Pattern,
    regions: Regions,
    edge_length: float | None = None,
    *,
    coarser: float = 1.0,
) -> tuple[OtherMesh, Bools]:
    """Mesh the same panels along the borders of regions (collective).

    Outlines and seams are kept, with their vertices where they turn. Where they are straight, and
    inside, the vertices are new. Borders are simplified by less than a twentieth of the mean width
    of the regions, so that their areas stay. With the mesh comes whether each triangle lies in a
    region, (t,).

    Args:
        comm: Communicator.
        pattern: Panels and seams.
        regions: A region of each panel, in m.
        edge_length: Length of edges outside of the regions in m; None takes that of the pattern.
        coarser: Factor on what the width of the regions allows: edges and errors of borders. A mesh
            that is coarser everywhere has longer edges too.

    Raises:
        PanelError: The number of regions is not that of the panels.
        PatternError: Borders of the regions meet, and the message says where; or the skin is
            moulded.
        ParameterError: The edge length, or the factor, is not above 0.
        MeshSizeError: There would be too many triangles.
    """
    pattern.require_flat_panels("a mesh along borders")
    pattern.require_regions(regions)
    fabric = equilateral_edge(float(pattern.areas.mean()))
    require_positive(coarser=coarser)
    if edge_length is not None:
        require_positive(edge_length=edge_length)
        require_affordable(float(pattern.areas.sum()), edge_length)
        fabric = edge_length
    regions = [_polygons(region) for region in regions]
    sizes = _sizes(pattern, fabric, regions, coarser)
    regions = [_thick(one, pattern.outline(k), sizes.joined) for k, one in enumerate(regions)]
    curves = [c for k, region in enumerate(regions) for c in _curves(pattern, k, region)]
    chains = _chains(pattern)
    chains, curves = _placed(pattern, chains, curves, sizes, regions)
    lines = _simplified(pattern, curves, sizes)
    return _meshed(pattern, chains, curves, lines, regions, sizes)


def _sizes(pattern: Pattern, fabric: float, regions: Regions, coarser: float) -> _Sizes:
    """Return the sizes that the mean width of all regions asks for."""
    area, border, near = 0.0, 0.0, ON_OUTLINE * pattern.size
    for region, outline in zip(regions, pattern.outlines, strict=True):
        inside = region.boundary.difference(outline.boundary.buffer(near))
        if inside.length:  # not of a panel that is printed all over
            area, border = area + region.area, border + inside.length
    width = 2 * area / border if border else fabric
    off = min(OFF_WIDTH * coarser * width, OFF_EDGE * fabric)
    joined = min(JOINED_WIDTH * width, JOINED * fabric)
    return _Sizes(fabric, min(coarser * width, FINER * fabric), off, joined)


def _thick(region: BaseGeometry, outline: BaseGeometry, least: float) -> BaseGeometry:
    """Return a region in an outline without gaps and pieces that are thinner than a width in m."""
    grid = GRID * least

    def thin(shape: BaseGeometry) -> BaseGeometry:
        opened = shape.buffer(-least / 2, join_style="mitre")
        return shape.difference(opened.buffer((0.5 + ROUNDING) * least, join_style="mitre"))

    inside = _polygons(shapely.intersection(region, outline, grid_size=grid))
    gaps = thin(_polygons(shapely.difference(outline, inside, grid_size=grid)))
    filled = _polygons(shapely.union(inside, _polygons(gaps), grid_size=grid))
    spurs = _polygons(thin(filled))
    return _polygons(shapely.difference(filled, spurs, grid_size=grid))


def _polygons(shape: BaseGeometry) -> BaseGeometry:
    return shapely.MultiPolygon(list(polygons_of(shape)))


# ------------------------------------------------------------------------------------- outlines


def _chains(pattern: Pattern) -> list[_Chain]:
    """Return the edges of all outlines as chains, whose inner vertices may be left out."""
    edges = edges_of(pattern.flat_triangles)
    flat = edges.ends[edges.border]
    free, _ = straight_on(pattern, flat)
    pairs = [(int(a), int(b)) for a, b in flat]
    around: dict[int, list[int]] = {}
    sides_of: dict[int, list[tuple[int, int]]] = {}
    done: set[int] = set()
    found = []

    def key_of(a: int, b: int) -> int:
        return int(edge_keys(pattern.sewn[[a, b]], len(pattern.points)))

    def walk(a: int, b: int) -> Ints:
        way = [a, b]
        while free[pattern.sewn[way[-1]]] and pattern.sewn[way[-1]] != pattern.sewn[way[0]]:
            one, two = around[way[-1]]
            way.append(two if one == way[-2] else one)
        return np.array(way)

    for a, b in pairs:
        around.setdefault(a, []).append(b)
        around.setdefault(b, []).append(a)
        sides_of.setdefault(key_of(a, b), []).append((a, b))
    both_ways = [*pairs, *((b, a) for a, b in pairs)]
    starts = sorted(pair for pair in both_ways if not free[pattern.sewn[pair[0]]])
    for a, b in [*starts, *pairs]:  # closed outlines without a corner come last
        key = key_of(a, b)
        if key in done:
            continue
        begin = pattern.sewn[a]
        both = [(c, d) if pattern.sewn[c] == begin else (d, c) for c, d in sides_of[key]]
        sides = [walk(c, d) for c, d in both]
        done.update(key_of(c, d) for c, d in pairwise(map(int, sides[0])))
        steps = np.diff(pattern.flat_points[sides[0]], axis=0)
        reach = np.append(0.0, np.cumsum(np.hypot(*steps.T)))
        found.append(_Chain(pattern.sewn[sides[0]], sides, reach, reach, []))
    return found


# -------------------------------------------------------------------------------------- borders


def _curves(pattern: Pattern, panel: int, region: BaseGeometry) -> list[_Curve]:
    """Return the parts of a region's border that are inside its panel."""
    outline, near = pattern.outline(panel).boundary, ON_OUTLINE * pattern.size
    shapely.prepare(outline)
    found = []
    for ring in shapely.get_rings(shapely.get_parts(region)):
        points = shapely.get_coordinates(ring)[:-1]
        points = points[np.any(points != np.roll(points, 1, axis=0), axis=1)]
        runs = runs_of_ring(points, outline, near)
        if runs is None:
            found.append(_Curve(panel, points, closed=True))
            continue
        found += [_Curve(panel, run, closed=False) for run, off in runs if off]
    return found


def _placed(
    pattern: Pattern, chains: Sequence[_Chain], curves: Sequence[_Curve], sizes: _Sizes,
    regions: Regions,
) -> tuple[list[_Chain], list[_Curve]]:  # fmt: skip
    """Return the chains with new vertices, and the curves that end in these."""
    pieces, ends = _pieces(chains)
    panel = pattern.panel_of_point[ends[:, 0]]
    wanted: list[list[float]] = [[] for _ in chains]
    lies_on: list[list[tuple[int, int, float]]] = []
    for curve in curves:
        here = np.flatnonzero(panel == curve.panel)
        begin, end = np.moveaxis(pattern.flat_points[ends[here]], 1, 0)
        found = []
        for point in () if curve.closed else curve.points[[0, -1]]:
            way = np.einsum("ij,ij->i", point - begin, end - begin)
            way = np.clip(way / np.einsum("ij,ij->i", end - begin, end - begin), 0, 1)
            away = np.hypot(*(begin + way[:, None] * (end - begin) - point).T)
            nearest = int(np.argmin(away))
            number, side, k = pieces[here[nearest]]
            place = chains[number].reach[k : k + 2]
            found.append((number, side, float(place[0] + way[nearest] * np.ptp(place))))
            wanted[number].append(found[-1][2])
        lies_on.append(found)
    divided = []
    for chain, values in zip(chains, wanted, strict=True):
        stops = _clustered(values, float(chain.reach[-1]), sizes.joined)
        divided.append(_divided_chain(pattern, chain, stops, sizes, regions))
    kept = []
    near = [outline.boundary.buffer(sizes.joined) for outline in pattern.outlines]
    for curve, found in zip(curves, lies_on, strict=True):
        if not curve.closed and near[curve.panel].covers(shapely.LineString(curve.points)):
            continue  # it follows the outline, of another number of sides for instance
        points = curve.points.copy()
        for end, (number, side, at) in zip((0, -1), found, strict=False):
            chain = divided[number]
            points[end] = chain.flat[side][np.abs(chain.place - at).argmin()]
        if curve.closed or (points[0] != points[-1]).any():
            kept.append(replace(curve, points=points))
    return divided, kept


def _pieces(chains: Sequence[_Chain]) -> tuple[list[tuple[int, int, int]], Ints]:
    """Return chain, side and number of each old piece of an outline, and its flat ends, (k, 2)."""
    pieces, ends = [], []
    for number, chain in enumerate(chains):
        for side, points in enumerate(chain.sides):
            pieces += [(number, side, k) for k in range(len(points) - 1)]
            ends.append(np.stack([points[:-1], points[1:]], axis=1))
    return pieces, np.concatenate(ends)


def _clustered(values: Sequence[float], length: float, joined: float) -> Floats:
    """Return both ends of a chain, and the means of close values between them."""
    groups: list[list[float]] = []
    for value in sorted(v for v in values if joined <= v <= length - joined):
        if groups and value - groups[-1][0] <= joined:
            groups[-1].append(value)
        else:
            groups.append([value])
    return np.array([0.0, *(float(np.mean(g)) for g in groups), length])


def _divided_chain(
    pattern: Pattern, chain: _Chain, stops: Floats, sizes: _Sizes, regions: Regions
) -> _Chain:
    """Return a chain with vertices at stops and between them; beside print they are closer."""
    parts = []
    for a, b in pairwise(stops):
        middle = [chain.at(pattern, side, np.array([(a + b) / 2]))[0] for side in chain.sides]
        printed = any(
            shapely.dwithin(
                regions[int(pattern.panel_of_point[side[0]])], shapely.Point(at),
                ON_OUTLINE * pattern.size,
            )
            for side, at in zip(chain.sides, middle, strict=True)
        )  # fmt: skip
        count = max(1, int(np.ceil((b - a) / (sizes.border if printed else sizes.fabric) - LONGER)))
        parts.append(np.linspace(a, b, count + 1)[:-1])
    place = np.append(np.concatenate(parts), stops[-1])
    if chain.vertices[0] == chain.vertices[-1] and len(place) < LOOP:
        place = np.linspace(0.0, stops[-1], LOOP)
    flat = [chain.at(pattern, side, place) for side in chain.sides]
    return replace(chain, place=place, flat=flat)


def _simplified(pattern: Pattern, curves: Sequence[_Curve], sizes: _Sizes) -> list[Floats]:
    """Return simpler curves, (k, 2), closed ones with their first point at both ends.

    Those that would meet another one, or an outline, keep more points.
    """
    tolerance = np.full(len(curves), sizes.off)
    for turn in range(HALVINGS + 1):
        lines = [_simple(c, t) for c, t in zip(curves, tolerance, strict=True)]
        bad = np.zeros(len(curves), dtype=bool)
        for panel in {c.panel for c in curves}:
            here = [k for k, c in enumerate(curves) if c.panel == panel]
            bad[here] = _meeting(pattern.outline(panel), [lines[k] for k in here])
        if not bad.any():
            break
        tolerance[bad] = tolerance[bad] / 2 if turn < HALVINGS - 1 else 0.0
    else:
        k = int(np.argmax(bad))
        place = 1e3 * lines[k].mean(axis=0)
        raise PatternError(
            f"borders of the print meet each other or the outline of panel "
            f"{pattern.panel_names[curves[k].panel]!r} near ({place[0]:.2f}, {place[1]:.2f}) mm, "
            "so that no mesh can follow them. Clean the print (larger gap and width), or draw "
            "them apart."
        )
    return [_divided(line, sizes.border) for line in lines]


def _simple(curve: _Curve, tolerance: float) -> Floats:
    points = np.concatenate([curve.points, curve.points[:1]]) if curve.closed else curve.points
    if tolerance == 0.0:
        return points
    shape = shapely.LinearRing(points) if curve.closed else shapely.LineString(points)
    simple = shapely.get_coordinates(shape.simplify(tolerance))
    return _with_area(points, simple, tolerance, closed=curve.closed)


def _with_area(points: Floats, simple: Floats, most: float, *, closed: bool) -> Floats:
    """Shift the vertices of a simpler line along mitres until it bounds the same area."""
    if len(simple) < 3:
        return simple
    line = simple[:-1] if closed else simple
    along = [np.roll(line, shift, axis=0) - line for shift in (1, -1)]
    one, two = (d / np.maximum(np.hypot(*d.T), 1e-300)[:, None] for d in (-along[0], along[1]))
    both = one[:, ::-1] * [1, -1] + two[:, ::-1] * [1, -1]
    mitre = 2 * both / np.maximum((both * both).sum(axis=1), 0.5)[:, None]
    if not closed:
        mitre[[0, -1]] = 0.0
    wanted, shift = _double_area(points), 0.0
    for _ in range(SHIFTS):
        off = _double_area(line + shift * mitre) - wanted
        slope = (_double_area(line + (shift + 1e-3 * most) * mitre) - wanted - off) / (1e-3 * most)
        if slope == 0 or abs(off) <= 1e-12 * abs(wanted):
            break
        shift = float(np.clip(shift - off / slope, -2 * most, 2 * most))
    moved = line + shift * mitre
    return np.concatenate([moved, moved[:1]]) if closed else moved


def _double_area(points: Floats) -> float:
    """Return twice the area of the polygon through points, (k, 2), in m²."""
    x, y = (points - points[0]).T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def _meeting(outline: BaseGeometry, lines: Sequence[Floats]) -> Bools:
    """Return whether each line meets another one or itself, or leaves the outline."""
    shapes = np.array([shapely.LineString(line) for line in lines])
    bad = ~shapely.is_simple(shapes)
    for k, line in enumerate(lines):
        closed = (line[0] == line[-1]).all()
        bad[k] |= len(line) < (4 if closed else 2)
        inner = line if closed else line[1:-1]
        bad[k] |= not shapely.contains_properly(outline, shapely.points(inner)).all()
    tree = shapely.STRtree(shapes)
    one, two = tree.query(shapes, predicate="intersects")
    for a, b in zip(one, two, strict=True):
        if a < b:
            common = shapely.get_coordinates(shapes[a].intersection(shapes[b]))
            ends = np.concatenate([lines[a][[0, -1]], lines[b][[0, -1]]])
            if not all((ends == point).all(axis=1).any() for point in common):
                bad[[a, b]] = True
    return np.asarray(bad)


def _divided(line: Floats, longest: float) -> Floats:
    """Return a line whose pieces are not much longer than a length, the same from both ends."""
    parts = []
    for a, b in pairwise(line):
        count = max(1, int(np.ceil(np.hypot(*(b - a)) / longest - LONGER)))
        parts.append(a + np.linspace(0, 1, count + 1)[:-1, None] * (b - a))
    return np.concatenate([*parts, line[-1:]])


# ----------------------------------------------------------------------------------------- mesh


class _Flat(NamedTuple):
    """Meshes of panels, one after the other.

    Attributes:
        points: Flat points, (m, 2), in m.
        triangles: Their corners, (t, 3).
        panel: Panel of each triangle, (t,).
        inside: Whether each triangle lies in a region, (t,).
        label: What is sewn: points with the same label are one vertex, (m,).
    """

    points: Floats
    triangles: Ints
    panel: Ints
    inside: Bools
    label: Ints


def _meshed(
    pattern: Pattern,
    chains: Sequence[_Chain],
    curves: Sequence[_Curve],
    lines: Sequence[Floats],
    regions: Regions,
    sizes: _Sizes,
) -> tuple[OtherMesh, Bools]:
    """Mesh all panels, and sew them as they were."""
    labels, next_label = [], len(pattern.points)
    for chain in chains:
        count = len(chain.place)
        label = next_label + np.arange(count)
        label[[0, -1]] = chain.vertices[[0, -1]]
        labels.append(label)
        next_label += count
    flat = []
    for panel in range(len(pattern.panel_names)):
        outline = [
            (places, label)
            for chain, label in zip(chains, labels, strict=True)
            for side, places in zip(chain.sides, chain.flat, strict=True)
            if pattern.panel_of_point[side[0]] == panel
        ]
        own = [line for c, line in zip(curves, lines, strict=True) if c.panel == panel]
        flat.append(_panel_mesh(panel, outline, own, regions[panel], sizes, next_label))
        next_label += len(flat[-1].points)
    begin = np.cumsum([0, *(len(part.points) for part in flat)])[:-1]
    whole = _Flat(
        np.concatenate([part.points for part in flat]),
        np.concatenate([b + part.triangles for b, part in zip(begin, flat, strict=True)]),
        *(np.concatenate([getattr(part, name) for part in flat]) for name in _Flat._fields[2:]),
    )
    whole = _without_bridges(whole)
    _, first, sewn = np.unique(whole.label, return_index=True, return_inverse=True)
    panel_of_point = np.zeros(len(whole.points), dtype=np.int64)
    panel_of_point[whole.triangles] = whole.panel[:, None]
    cell, weight = located(pattern, panel_of_point[first], whole.points[first])
    ends = pattern.triangles[cell]
    inner = np.ones(len(first), dtype=bool)
    of_label = np.full(next_label + len(whole.points), -1)
    of_label[whole.label] = sewn
    for chain, label in zip(chains, labels, strict=True):
        # Vertices on an outline lie between two of the pattern.
        k = np.clip(np.searchsorted(chain.reach, chain.place) - 1, 0, len(chain.reach) - 2)
        way = (chain.place - chain.reach[k]) / (chain.reach[k + 1] - chain.reach[k])
        vertex = of_label[label]
        ends[vertex] = np.stack([chain.vertices[i] for i in (k, k + 1, k + 1)], axis=1)
        weight[vertex] = np.stack([1 - way, way, 0 * way], axis=1)
        inner[vertex] = False
    rows = np.arange(len(ends))[:, None]
    ends = np.where(weight > 0, ends, ends[rows, np.argmax(weight, axis=1)[:, None]])
    points = np.einsum("ij,ijk->ik", weight, pattern.points[ends])
    points[inner] = places_on(pattern, cell[inner], weight[inner], curved=inner[inner])
    found = replace(
        pattern,
        flat_points=whole.points,
        flat_triangles=whole.triangles,
        panel=whole.panel,
        sewn=sewn,
        points=points,
    )
    within = located(pattern, found.panel, found.centroids)[0]
    return OtherMesh(pattern, found, within, ends, weight), whole.inside


def _panel_mesh(
    panel: int,
    outline: Sequence[tuple[Floats, Ints]],
    lines: Sequence[Floats],
    region: BaseGeometry,
    sizes: _Sizes,
    label: int,
) -> _Flat:
    """Mesh a panel along its outline, whose points have labels, and along lines inside it."""
    paths = [places for places, _ in outline] + list(lines)
    corners, number = np.unique(np.concatenate(paths), axis=0, return_inverse=True)
    known = np.full(len(corners), -1)
    on_outline = sum(len(places) for places, _ in outline)
    known[number.ravel()[:on_outline]] = np.concatenate([label for _, label in outline])
    of_place = {(float(x), float(y)): k for k, (x, y) in enumerate(corners)}
    pieces = np.concatenate([np.stack([path[:-1], path[1:]], axis=1) for path in paths])
    faces = shapely.get_parts(shapely.polygonize(shapely.linestrings(pieces)))
    inside = shapely.area(shapely.intersection(faces, region)) > 0.5 * shapely.area(faces)
    rings = [
        [
            [of_place[float(x), float(y)] for x, y in shapely.get_coordinates(ring)[:-1]]
            for ring in shapely.get_rings(face)
        ]
        for face in faces
    ]  # fmt: skip
    points, triangles, face = faces_mesh(corners, rings, sizes.fabric)
    more = label + np.arange(len(points))
    more[: len(corners)] = np.where(known < 0, more[: len(corners)], known)
    return _Flat(points, triangles, np.full(len(triangles), panel), inside[face], more)


def _without_bridges(flat: _Flat) -> _Flat:
    """Halve edges inside a panel whose ends are sewn to those of another edge."""
    while True:
        label = np.unique(flat.label, return_inverse=True)[1]
        edges = edges_of(flat.triangles)
        key, count = np.unique(
            edge_keys(label[edges.ends], len(label)), return_inverse=True, return_counts=True
        )[1:]
        bridge = (edges.count == 2) & (count[key] > 1)
        if not bridge.any():
            return flat
        a, b = edges.ends[np.argmax(bridge)]
        middle, beside = len(flat.points), np.isin(flat.triangles, [a, b]).sum(axis=1) == 2
        panel, inside = (
            np.concatenate([value[~beside], value[beside], value[beside]])
            for value in (flat.panel, flat.inside)
        )
        halves = [np.where(flat.triangles[beside] == end, middle, flat.triangles[beside])
                  for end in (a, b)]  # fmt: skip
        flat = _Flat(
            np.concatenate([flat.points, flat.points[[a, b]].mean(axis=0)[None]]),
            np.concatenate([flat.triangles[~beside], *halves]),
            panel,
            inside,
            np.append(flat.label, flat.label.max() + 1),
        )
