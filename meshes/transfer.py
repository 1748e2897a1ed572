"""Fields and shapes from one mesh of a pattern to another; uniform refinement."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy.sparse import csr_array

from toros_fem.base.errors import PanelError
from toros_fem.base.validation import Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import (
    barycentric,
    cross,
    edges_of,
    flat_areas,
    half_edges,
    require_fewer,
)

# Largest relative difference in size of a panel on two meshes; a round outline that is a polygon
# of six sides on one of them is smaller by 17 % in its area and by 13 % in its width.
SAME_SIZE = 0.15
# An overlap smaller than this fraction of the triangle is rounding.
ROUNDING = 1e-12
# Source triangles at a border reach beyond it by this fraction of their size: small triangles
# between a circle and a side of a coarse polygon find one too.
BEYOND = 0.25
# Pairs of triangles treated at once: the work arrays stay small.
PAIRS = 500_000


@dataclass(frozen=True, eq=False)
class OtherMesh:
    """A finer mesh of the same flat panels with the same seams, and its relation to the first one.

    Attributes:
        source, pattern: The first pattern, and the finer one.
        cell: Triangle of the source in which each triangle, by its centroid, lies, (t,).
        ends: Vertices of the source between which each assembled vertex lies, (n, k): on an edge
            its ends, in a triangle its corners, each of them at least once.
        weights: Share of each of them, (n, k).
    """

    source: Pattern
    pattern: Pattern
    cell: Ints
    ends: Ints
    weights: Floats

    def at_vertices(self, values: Floats) -> Floats:
        """Interpolate values at the source's vertices, (n, …)."""
        return np.asarray(np.einsum("ij,ij...->i...", self.weights, values[self.ends]))

    def free_edges(self) -> Ints:
        """Return the free edge of the source on which each free edge lies, (k,)."""
        (panel, ends), (others, of_others) = map(_flat_free_edges, (self.source, self.pattern))
        found, middles = np.full(len(others), -1), of_others.mean(axis=1)
        for number in np.unique(others):
            here, there = np.flatnonzero(panel == number), others == number
            tree = shapely.STRtree(shapely.linestrings(ends[here]))
            found[there] = here[tree.nearest(shapely.points(middles[there]))]
        return found


def _flat_free_edges(pattern: Pattern) -> tuple[Ints, Floats]:
    """Return panel and flat ends of each free edge, (k,) and (k, 2, 2)."""
    half = pattern.edges.twins[pattern.edges.border, 0]
    ends = pattern.flat_points[half_edges(pattern.flat_triangles)[half]]
    return pattern.panel[half // 3], ends


def refine(pattern: Pattern) -> OtherMesh:
    """Divide each triangle into four by the middles of its edges; panels keep their outlines."""
    require_fewer(4 * len(pattern.panel), float(pattern.areas.sum()))
    flat, tri = pattern.flat_points, pattern.flat_triangles
    edges, count = edges_of(tri), len(pattern.points)
    # Two flat edges that are sewn together share their middle.
    sewn_ends = np.sort(pattern.sewn[edges.ends], axis=1)
    ends, sewn_middle = np.unique(sewn_ends, axis=0, return_inverse=True)
    a, b, c = tri.T
    ab, bc, ca = len(flat) + edges.of_triangle.T
    quarters = np.array([(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)])
    vertices = np.concatenate([np.repeat(np.arange(count)[:, None], 2, axis=1), ends])
    fine = replace(
        pattern,
        flat_points=np.concatenate([flat, flat[edges.ends].mean(axis=1)]),
        flat_triangles=quarters.transpose(2, 0, 1).reshape(-1, 3),
        panel=np.repeat(pattern.panel, 4),
        sewn=np.concatenate([pattern.sewn, count + sewn_middle.ravel()]),
        points=pattern.points[vertices].mean(axis=1),
    )
    halves = np.full(vertices.shape, 0.5)
    return OtherMesh(pattern, fine, np.repeat(np.arange(len(tri)), 4), vertices, halves)


@dataclass(frozen=True, eq=False)
class Transfer:
    """A map of fields from one mesh of a pattern to another mesh of the same flat panels.

    Places are the same if panel and flat position are the same. Where a panel has a slightly
    different size, as that of a tube which is a prism of another number of sides, it is scaled.

    Attributes:
        source, target: The two patterns.
        overlap: Area in m² of each target triangle, on the source panel, that lies in each source
            triangle, (target triangles, source triangles).
        cell: Source triangle in which each flat point of the target lies.
        weight: Barycentric coordinates of the flat point in it, (m, 3); a point outside of the
            source panel has those of the border.
    """

    source: Pattern
    target: Pattern
    overlap: csr_array
    cell: Ints
    weight: Floats

    def at_cells(self, values: Floats) -> Floats:
        """Return values of the target's triangles, (t,), as means over what each covers.

        The mean over each panel is kept, and with equal panels the integral. No value leaves the
        range of the values on its panel.
        """
        found = np.asarray(self.overlap @ values) / np.asarray(self.overlap.sum(axis=1))
        for name in self.target.panel_names:
            here, there = self.target.cells_of(name), self.source.cells_of(name)
            low, high = values[there].min(), values[there].max()
            mean = np.average(values[there], weights=self.source.areas[there])
            part, areas = np.clip(found[here], low, high), self.target.areas[here]
            missing = mean - np.average(part, weights=areas)
            # The same fraction of the way to the bound: nothing leaves the range.
            bound = high if missing > 0 else low
            way = np.average(bound - part, weights=areas)
            part = part + (missing / way * (bound - part) if way else 0.0)
            found[here] = np.clip(part, low, high)  # rounding
        return found

    def at_vertices(self, values: Floats) -> Floats:
        """Return values at vertices, (n, …), interpolated in the flat triangles; means at seams."""
        corners = values[self.source.triangles[self.cell]]
        inside = np.einsum("ij,ij...->i...", self.weight, corners)
        return self.target.mean_over_flat_points(inside)

    def positions(self, deformed: Floats) -> Floats:
        """Return a deformed shape of the target, (n, 3), from one of the source, in m.

        Assembled vertices of the target lie off the source's flat triangles where the skin is
        curved. This small offset turns with the triangle.
        """
        triangles = self.source.triangles
        before, after = _frames(self.source.points[triangles]), _frames(deformed[triangles])
        flat, moved = (
            np.einsum("ij,ijk->ik", self.weight, points[triangles[self.cell]])
            for points in (self.source.points, deformed)
        )
        offset = self.target.points[self.target.sewn] - flat
        local = np.einsum("ikj,ik->ij", before[self.cell], offset)
        turned = np.einsum("ikj,ij->ik", after[self.cell], local)
        return self.target.mean_over_flat_points(moved + turned)


def make_transfer(source: Pattern, target: Pattern) -> Transfer:
    """Return the transfer between two meshes of the same panels, with exact overlaps.

    Raises:
        PanelError: The names of the panels are not the same, or a panel has another size or
            outline.
        PatternError: A skin is moulded.
    """
    for pattern in (source, target):
        pattern.require_flat_panels("transfer between meshes")
    count = len(target.flat_points)
    cell, weight = np.zeros(count, dtype=np.int64), np.zeros((count, 3))
    best = np.full(count, -np.inf)
    overlaps: list[tuple[Ints, Ints, Floats]] = []
    flat = scaled_points(source, target)
    for one, two in _neighbours(source, target, flat):
        inside = barycentric(source.corners[two], flat[target.flat_triangles[one]])
        _locate(target.flat_triangles[one], two, inside, cell, weight, best)
        near = ~np.any(np.all(inside <= 0, axis=1), axis=1)
        one, two = one[near], two[near]
        overlaps.append((one, two, _clipped(inside[near]) * source.areas[two]))
    row, column, area = (np.concatenate(parts) for parts in zip(*overlaps, strict=True))
    real = area > ROUNDING * flat_areas(flat[target.flat_triangles])[row]
    shape = (len(target.panel), len(source.panel))
    overlap = csr_array((area[real], (row[real], column[real])), shape=shape)
    _check_cover(source, target, overlap)
    # Triangles outside of the source take the source triangle nearest to their first corner.
    bare = np.flatnonzero(np.asarray(overlap.sum(axis=1)) == 0)
    if len(bare):
        near = cell[target.flat_triangles[bare, 0]]
        overlap = overlap + csr_array((target.areas[bare], (bare, near)), shape=shape)
    inner = np.maximum(weight, 0.0)
    return Transfer(source, target, overlap, cell, inner / inner.sum(axis=1, keepdims=True))


def scaled_points(source: Pattern, target: Pattern, *, any_size: bool = False) -> Floats:
    """Return the target's flat points, each panel scaled to the source's bounding box.

    A PanelError says that the panels are others, or that their sizes differ if they may not.
    """
    if sorted(source.panel_names) != sorted(target.panel_names):
        raise PanelError(
            f"the panels are named {list(source.panel_names)} on one mesh and "
            f"{list(target.panel_names)} on the other; they must be the same panels."
        )
    flat = target.flat_points.copy()
    for name in target.panel_names:
        points = np.flatnonzero(target.panel_of_point == target.panel_index(name))
        own = target.flat_points[points]
        other = source.flat_points[source.panel_of_point == source.panel_index(name)]
        size, wanted = np.ptp(own, axis=0), np.ptp(other, axis=0)
        if not any_size and np.any(np.abs(size - wanted) > SAME_SIZE * wanted):
            raise PanelError(
                f"panel {name!r} is {size} m wide on one mesh and {wanted} m on the other; the "
                f"bound is a relative difference of {SAME_SIZE:g}. Both must be meshes of the "
                "same flat panels."
            )
        flat[points] = other.min(axis=0) + (own - own.min(axis=0)) * (wanted / size)
    return flat


def _neighbours(source: Pattern, target: Pattern, flat: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Yield pairs of a target and a source triangle of one panel whose bounding boxes meet."""
    edges, beyond = edges_of(source.flat_triangles), np.zeros((len(source.panel), 1))
    beyond[edges.sides[edges.border, 0]] = BEYOND

    def boxes(corners: Floats, beyond: Floats | float = 0.0) -> np.ndarray:
        more = beyond * np.ptp(corners, axis=1)
        low, high = corners.min(axis=1) - more, corners.max(axis=1) + more
        return np.asarray(shapely.box(*np.hstack([low, high]).T))

    for name in target.panel_names:
        here, there = target.cells_of(name), source.cells_of(name)
        tree = shapely.STRtree(boxes(source.corners[there], beyond[there]))
        one, two = tree.query(boxes(flat[target.flat_triangles[here]]))
        for part in np.array_split(np.arange(len(one)), 1 + len(one) // PAIRS):
            yield here[one[part]], there[two[part]]


def _locate(
    points: Ints, around: Ints, inside: Floats, cell: Ints, weight: Floats, best: Floats
) -> None:
    """Take over, for each flat point, the triangle that it lies in or is nearest to, in place."""
    depth, point = inside.min(axis=2).ravel(), points.ravel()
    order = np.lexsort((-depth, point))
    first = order[np.flatnonzero(np.diff(point[order], prepend=-1))]
    better = first[depth[first] > best[point[first]]]
    best[point[better]] = depth[better]
    cell[point[better]] = around[better // 3]
    weight[point[better]] = inside.reshape(-1, 3)[better]


def _clipped(polygon: Floats) -> Floats:
    """Return which fraction of a triangle each other one covers, (k,).

    A triangle is given by its barycentric coordinates in the other, (k, 3, 3). Each clip by a side,
    where a coordinate is 0, adds at most one corner (Sutherland and Hodgman 1974).
    """
    fraction = np.zeros(len(polygon))
    whole = np.all(polygon >= 0, axis=(1, 2))
    fraction[whole], rest = _polygon_area(polygon[whole]), polygon[~whole]
    for side in range(3):
        rest = _clip(rest, side)
    fraction[~whole] = _polygon_area(rest)
    return fraction


def _clip(polygon: Floats, side: int) -> Floats:
    """Return the part of polygons (k, n, 3) with a coordinate ≥ 0, (k, n + 1, 3)."""
    count, corners, _ = polygon.shape
    here, following = polygon[..., side], np.roll(polygon[..., side], -1, axis=1)
    kept, crossing = here >= 0, (here >= 0) != (following >= 0)
    fraction = here / np.where(crossing, here - following, 1.0)
    between = polygon + fraction[..., None] * (np.roll(polygon, -1, axis=1) - polygon)
    points = np.stack([polygon, between], axis=2).reshape(count, 2 * corners, 3)
    valid = np.stack([kept, crossing], axis=2).reshape(count, 2 * corners)
    order = np.argsort(~valid, axis=1, kind="stable")[:, : corners + 1]
    rest = np.arange(corners + 1) >= valid.sum(axis=1, keepdims=True)
    # Places that are not needed repeat the first corner, which adds no area.
    order = np.where(rest, order[:, :1], order)
    clipped = np.take_along_axis(points, order[..., None], axis=1)
    clipped[~valid.any(axis=1)] = 0.0
    return clipped


def _polygon_area(polygon: Floats) -> Floats:
    """Return the area of polygons (k, n, 3) over that of the triangle of the coordinates."""
    away = polygon[:, 1:, 1:] - polygon[:, :1, 1:]
    return np.asarray(cross(away[:, :-1], away[:, 1:]).sum(axis=1))


def _check_cover(source: Pattern, target: Pattern, overlap: csr_array) -> None:
    """Check that both meshes cover most of each panel."""
    covered = np.asarray(overlap.sum(axis=1))
    for name in target.panel_names:
        whole = source.areas[source.cells_of(name)].sum()
        part = covered[target.cells_of(name)].sum() / whole
        if part < 1 - SAME_SIZE:
            raise PanelError(
                f"panel {name!r}: only {100 * part:.0f} % of it are covered by the other mesh. "
                "Both must be meshes of the same flat panels."
            )


def _frames(corners: Floats) -> Floats:
    """Return an orthonormal basis along each triangle (k, 3, 3) in its columns."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    first = u / np.linalg.norm(u, axis=1, keepdims=True)
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first), normal], axis=2)
