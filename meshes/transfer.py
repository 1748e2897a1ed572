"""Transfer of fields from one mesh of a pattern to another: densities, and deformed shapes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import PanelError, PatternError
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import flat_areas

# Largest relative difference in size of a panel on two meshes; a round outline that is a polygon
# of six sides on one of them is smaller by 17 % in its area and by 13 % in its width.
SAME_SIZE = 0.15
# An overlap smaller than this fraction of the triangle is rounding.
ROUNDING = 1e-12
# Pairs of triangles treated at once: the work arrays stay small.
PAIRS = 500_000


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

        Args:
            values: Values of the source's triangles, such as densities.

        Raises:
            PatternError: The values do not fit the source.
        """
        if values.shape != (self.overlap.shape[1],):
            raise PatternError(
                f"values has shape {values.shape}; it must be ({self.overlap.shape[1]},), one for "
                "each triangle of the source."
            )
        found = np.asarray(self.overlap @ values) / np.asarray(self.overlap.sum(axis=1))
        for name in self.target.panel_names:
            here, there = self.target.cells_of(name), self.source.cells_of(name)
            low, high = values[there].min(), values[there].max()
            mean = np.average(values[there], weights=self.source.areas[there])
            part = np.clip(found[here], low, high)
            missing = mean - np.average(part, weights=self.target.areas[here])
            # The same fraction of the way to the bound: nothing leaves the range.
            bound = high if missing > 0 else low
            way = np.average(bound - part, weights=self.target.areas[here])
            part = part + (missing / way * (bound - part) if way else 0.0)
            found[here] = np.clip(part, low, high)  # rounding
        return found

    def at_vertices(self, values: Floats) -> Floats:
        """Return values at the target's vertices, (n, …), interpolated in the flat triangles.

        A vertex on a seam has the mean over its panels.

        Args:
            values: Values at all assembled vertices of the source, (m, …).
        """
        corners = values[self.source.triangles[self.cell]]
        return self._sewn(np.einsum("ij,ij...->i...", self.weight, corners))

    def positions(self, deformed: Floats) -> Floats:
        """Return a deformed shape of the target, (n, 3), in m, from one of the source.

        Assembled vertices of the target lie off the source's flat triangles where the skin is
        curved. This small offset turns with the triangle.

        Args:
            deformed: Positions of all assembled vertices of the source, (m, 3), in m.
        """
        triangles = self.source.triangles
        before = _frames(self.source.points[triangles])
        after = _frames(deformed[triangles])
        corners = self.source.points[triangles[self.cell]]
        offset = self.target.points[self.target.sewn] - np.einsum(
            "ij,ijk->ik", self.weight, corners
        )
        local = np.einsum("ikj,ik->ij", before[self.cell], offset)
        moved = np.einsum("ij,ijk->ik", self.weight, deformed[triangles[self.cell]])
        return self._sewn(moved + np.einsum("ikj,ij->ik", after[self.cell], local))

    def _sewn(self, values: Floats) -> Floats:
        """Return the mean at each assembled vertex over its flat points."""
        sewn, count = self.target.sewn, len(self.target.points)
        matrix = csr_array(
            (np.ones(len(sewn)), (sewn, np.arange(len(sewn)))), shape=(count, len(sewn))
        )
        flat = values.reshape(len(values), -1)
        mean = (matrix @ flat) / np.bincount(sewn, minlength=count)[:, None]
        return np.asarray(mean).reshape(count, *values.shape[1:])


def make_transfer(source: Pattern, target: Pattern) -> Transfer:
    """Return the transfer between two meshes of the same panels.

    The overlap of two triangles is exact: one is clipped by the three sides of the other.

    Args:
        source: The pattern that has the fields.
        target: The pattern that gets them.

    Raises:
        PanelError: The names of the panels are not the same, or a panel has another size or
            outline.
        PatternError: A skin is moulded.
    """
    for pattern in (source, target):
        pattern.require_flat_panels("transfer between meshes")
    if sorted(source.panel_names) != sorted(target.panel_names):
        raise PanelError(
            f"the panels are named {list(source.panel_names)} on one mesh and "
            f"{list(target.panel_names)} on the other; they must be the same panels."
        )
    count = len(target.flat_points)
    rows: list[Ints] = []
    columns: list[Ints] = []
    areas: list[Floats] = []
    cell, weight = np.zeros(count, dtype=np.int64), np.zeros((count, 3))
    best = np.full(count, -np.inf)
    flat = scaled_points(source, target)
    for name in target.panel_names:
        here, there = target.cells_of(name), source.cells_of(name)
        corners, around = flat[target.flat_triangles[here]], source.corners[there]
        for one, two in _candidates(corners, around):
            inside = _barycentric(corners[one], around[two])
            _locate(target.flat_triangles[here][one], there[two], inside, cell, weight, best)
            kept = ~np.any(np.all(inside <= 0, axis=1), axis=1)
            one, two = one[kept], two[kept]
            rows.append(here[one])
            columns.append(there[two])
            areas.append(_clipped(inside[kept]) * source.areas[there[two]])
    row, column, area = (np.concatenate(parts) for parts in (rows, columns, areas))
    own = flat_areas(flat[target.flat_triangles])
    real = area > ROUNDING * own[row]
    shape = (len(target.panel), len(source.panel))
    overlap = csr_array((area[real], (row[real], column[real])), shape=shape)
    _check_cover(source, target, overlap)
    inner = np.maximum(weight, 0.0)
    inner /= inner.sum(axis=1, keepdims=True)
    return Transfer(source, target, _with_nearest(overlap, target, cell), cell, inner)


def scaled_points(source: Pattern, target: Pattern) -> Floats:
    """Return the target's flat points, each panel scaled to the source's bounding box.

    Raises:
        PanelError: A panel has another size on the two meshes.
    """
    flat = target.flat_points.copy()
    for name in target.panel_names:
        points = np.unique(target.flat_triangles[target.cells_of(name)])
        own = target.flat_points[points]
        other = source.flat_points[np.unique(source.flat_triangles[source.cells_of(name)])]
        size, wanted = np.ptp(own, axis=0), np.ptp(other, axis=0)
        if np.any(np.abs(size - wanted) > SAME_SIZE * wanted):
            raise PanelError(
                f"panel {name!r} is {size} m wide on one mesh and {wanted} m on the other; the "
                f"bound is a relative difference of {SAME_SIZE:g}. Both must be meshes of the "
                "same flat panels."
            )
        flat[points] = other.min(axis=0) + (own - own.min(axis=0)) * (wanted / size)
    return flat


def _candidates(one: Floats, two: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Yield pairs of triangles (k, 3, 2) that may overlap.

    Triangles of similar size are searched together, so that a few large ones cost little.
    """
    centres, radii = zip(*(_circles(corners) for corners in (one, two)), strict=True)
    classes = [np.floor(np.log2(radius)).astype(np.int64) for radius in radii]
    for large in np.unique(classes[1]):
        there = np.flatnonzero(classes[1] == large)
        tree = cKDTree(centres[1][there])
        for small in np.unique(classes[0]):
            here = np.flatnonzero(classes[0] == small)
            reach = float(radii[0][here].max() + radii[1][there].max())
            expected = 1 + 4 * (reach / radii[1][there].mean()) ** 2
            step = max(1, int(PAIRS / expected))
            for begin in range(0, len(here), step):
                part = here[begin : begin + step]
                found = cKDTree(centres[0][part]).sparse_distance_matrix(
                    tree, reach, output_type="ndarray"
                )
                first, second = part[found["i"]], there[found["j"]]
                near = found["v"] <= radii[0][first] + radii[1][second]
                yield first[near], second[near]


def _circles(corners: Floats) -> tuple[Floats, Floats]:
    """Return the centroid of each triangle, and the distance of its furthest corner."""
    centre = corners.mean(axis=1)
    return centre, np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)


def _barycentric(corners: Floats, around: Floats) -> Floats:
    """Return the coordinates of corners (k, 3, 2) in other triangles (k, 3, 2), (k, 3, 3)."""
    a, b, c = np.moveaxis(around, 1, 0)
    u, v, w = b - a, c - a, corners - a[:, None]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    second = (w[..., 0] * v[:, None, 1] - w[..., 1] * v[:, None, 0]) / area[:, None]
    third = (u[:, None, 0] * w[..., 1] - u[:, None, 1] * w[..., 0]) / area[:, None]
    return np.stack([1 - second - third, second, third], axis=2)


def _locate(
    points: Ints, around: Ints, inside: Floats, cell: Ints, weight: Floats, best: Floats
) -> None:
    """Take over, for each flat point, the triangle that it lies in or is nearest to."""
    depth, point = inside.min(axis=2).ravel(), points.ravel()
    order = np.lexsort((-depth, point))
    first = order[np.flatnonzero(np.diff(point[order], prepend=-1))]
    better = first[depth[first] > best[point[first]]]
    best[point[better]] = depth[better]
    cell[point[better]] = around[better // 3]
    weight[point[better]] = inside.reshape(-1, 3)[better]


def _clipped(polygon: Floats) -> Floats:
    """Return which fraction of a triangle each other one covers, (k,).

    Args:
        polygon: Barycentric coordinates of the other's corners, (k, 3, 3). Each clip by a side,
            where a coordinate is 0, adds at most one corner (Sutherland and Hodgman 1974).
    """
    fraction = np.zeros(len(polygon))
    whole = np.all(polygon >= 0, axis=(1, 2))
    fraction[whole] = _polygon_area(polygon[whole])
    cut = np.flatnonzero(~whole)
    polygon = polygon[cut]
    for side in range(3):
        polygon = _clip(polygon, side)
    fraction[cut] = _polygon_area(polygon)
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
    one, two = away[:, :-1], away[:, 1:]
    return np.asarray((one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]).sum(axis=1))


def _check_cover(source: Pattern, target: Pattern, overlap: csr_array) -> None:
    """Check that both meshes cover most of each panel."""
    covered = np.asarray(overlap.sum(axis=1))
    for name in target.panel_names:
        part = covered[target.cells_of(name)].sum()
        whole = source.areas[source.cells_of(name)].sum()
        if part < (1 - SAME_SIZE) * whole:
            raise PanelError(
                f"panel {name!r}: only {100 * part / whole:.0f} % of it are covered by the other "
                "mesh. Both must be meshes of the same flat panels."
            )


def _with_nearest(overlap: csr_array, target: Pattern, cell: Ints) -> csr_array:
    """Give triangles outside of the source the source triangle nearest to their first corner."""
    empty = np.flatnonzero(np.asarray(overlap.sum(axis=1)) == 0)
    if len(empty) == 0:
        return overlap
    near = cell[target.flat_triangles[empty, 0]]
    return overlap + csr_array((target.areas[empty], (empty, near)), shape=overlap.shape)


def _frames(corners: Floats) -> Floats:
    """Return an orthonormal basis along each triangle (k, 3, 3) in its columns."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    first = u / np.linalg.norm(u, axis=1, keepdims=True)
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first), normal], axis=2)
