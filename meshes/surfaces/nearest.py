"""The place on a surface that is nearest to a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.triangles import surface_areas

# Points that are looked for at once: each has a list of triangles near to it.
AT_ONCE = 512
# Shares of a corner below this are rounding: a place on an edge is on it.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Nearest:
    """Nearest places of some points on a surface.

    Attributes:
        distance: Distance of each point in m, (k,).
        triangle: Number of the triangle that the place is in, (k,).
        shares: Share of each of its corners in the place, (k, 3).
    """

    distance: Floats
    triangle: Ints
    shares: Floats

    def weights(self, triangles: Ints, count: int) -> csr_array:
        """Return the matrix (k, n) that interpolates values at n vertices to the places."""
        rows = np.repeat(np.arange(len(self.triangle)), 3)
        columns = triangles[self.triangle].ravel()
        return csr_array((self.shares.ravel(), (rows, columns)), shape=(len(self.triangle), count))


def nearest(points: Floats, vertices: Floats, triangles: Ints) -> Nearest:
    """Return the places that are nearest to points (k, 3) on triangles (t, 3) between vertices."""
    corners, count = vertices[triangles], len(points)
    found = Nearest(np.full(count, np.inf), np.zeros(count, dtype=np.int64), np.zeros((count, 3)))
    area = float(surface_areas(vertices, triangles).sum())
    size = float(np.sqrt(area / count))
    places, of = _samples(corners, size)
    tree = cKDTree(places)
    for begin in range(0, count, AT_ONCE):
        some = np.arange(begin, min(begin + AT_ONCE, count))
        far = tree.query(points[some])[0] + size
        lists = tree.query_ball_point(points[some], far)
        near = np.concatenate([np.asarray(one, dtype=np.int64) for one in lists])
        pairs = np.repeat(some, [len(one) for one in lists]) * len(triangles) + of[near]
        point, cell = np.divmod(np.unique(pairs), len(triangles))
        _keep_nearest(found, point, cell, points, corners)
    return found


def _samples(corners: Floats, size: float) -> tuple[Floats, Ints]:
    """Return places on triangles (t, 3, 3), and the triangle of each.

    No place of a triangle is further than a size in m from one of these. Triangles are halved until
    they are low enough for a row of places along the longest side.
    """
    pieces, of = corners, np.arange(len(corners))
    places, owners = list[Floats](), list[Ints]()
    while len(pieces):
        sides = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
        order = (sides.argmax(axis=1)[:, None] + np.arange(3)) % 3  # the longest side first
        a, b, c = np.moveaxis(np.take_along_axis(pieces, order[..., None], axis=1), 1, 0)
        length = sides.max(axis=1)
        height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / length
        low = height <= size / 2
        several = np.ceil(length[low] / size).astype(np.int64)
        row = np.repeat(np.flatnonzero(low), several)
        along = np.arange(len(row)) - np.repeat(np.cumsum(several) - several, several)
        part = (along + 0.5) / np.repeat(several, several)
        places.append(a[row] + part[:, None] * (b - a)[row])
        owners.append(of[row])
        a, b, c, of = a[~low], b[~low], c[~low], np.tile(of[~low], 2)
        middle = (a + b) / 2
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        pieces = np.concatenate(halves)
    return np.concatenate(places), np.concatenate(owners)


def _keep_nearest(found: Nearest, point: Ints, cell: Ints, points: Floats, corners: Floats) -> None:
    """Keep of each point the nearest of some triangles."""
    shares = _shares(points[point], corners[cell])
    place = np.einsum("pk,pki->pi", shares, corners[cell])
    distance = np.linalg.norm(points[point] - place, axis=1)
    order = np.lexsort((distance, point))
    least = order[np.unique(point[order], return_index=True)[1]]
    found.distance[point[least]] = distance[least]
    found.triangle[point[least]] = cell[least]
    found.shares[point[least]] = shares[least]


def _shares(points: Floats, corners: Floats) -> Floats:
    """Return the shares of corners (p, 3, 3) in the places nearest to points (p, 3), (p, 3)."""
    along = np.roll(corners, -1, axis=1) - corners
    away = points[:, None] - corners
    normal = np.cross(along[:, 0], along[:, 1])
    # The side opposite of a corner, and the part of the area beyond it.
    area = np.einsum("psi,pi->ps", np.cross(along, away), normal)
    inside = np.roll(area, -1, axis=1) / np.einsum("pi,pi->p", normal, normal)[:, None]
    way = np.einsum("psi,psi->ps", away, along) / np.einsum("psi,psi->ps", along, along)
    way = np.clip(way, 0, 1)
    side = np.linalg.norm(away - way[..., None] * along, axis=2).argmin(axis=1)
    rows = np.arange(len(points))
    on_side = np.zeros((len(points), 3))
    on_side[rows, side] = 1 - way[rows, side]
    on_side[rows, (side + 1) % 3] = way[rows, side]
    shares = np.where((inside >= 0).all(axis=1)[:, None], inside, on_side)
    shares[shares < ROUNDING] = 0.0
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))
