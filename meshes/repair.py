"""Mending what files hold: vertices told twice, triangles told twice, needles and caps."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from toros_fem._types import Floats, Ints
from toros_fem.meshes.topology import edges_of, normals, shapes

# Vertices closer than this share of the bounding box's diagonal are one.
COINCIDENT = 1e-7
# Triangles thinner than this (height over longest edge) are mended.
THIN = 1e-3
PASSES = 50


def weld(points: Floats, triangles: Ints) -> tuple[Ints, Ints]:
    """Join vertices that lie at the same place and drop triangles that are left without sense.

    Args:
        points: Vertices (n, 3).
        triangles: Corners (t, 3).

    Returns:
        For each vertex the one that stands for it, (n,), and the triangles that stay, by index:
        those with three corners, each set of corners once.
    """
    reach = COINCIDENT * float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    size = len(points)
    same = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    label = connected_components(same, directed=False)[1]
    stands_for = np.unique(label, return_index=True)[1][label].astype(np.int64)
    corners = np.sort(stands_for[triangles], axis=1)
    first = np.unique(corners, axis=0, return_index=True)[1]
    proper = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])
    return stands_for, np.sort(first[proper[first]])


def mend(
    points: Floats, triangles: Ints, parts: Ints, kept: Ints
) -> tuple[Floats, Ints, Ints, Ints, dict[str, int]]:
    """Remove triangles thinner than `THIN`, where that is simple.

    A needle's short edge is collapsed, a cap's long edge is flipped, or the cap dropped where
    that edge is a border; the surface moves by less than `THIN` of the longest edge. What would
    change the topology, fold the surface over or move a kept edge is left as it is.

    Args:
        points: Vertices (n, 3).
        triangles: Consistently oriented manifold triangles (t, 3).
        parts: Part of each triangle (t,); borders between parts are kept.
        kept: Edges (k, 2) that are kept.

    Returns:
        Points (n, 3), triangles, parts, for each old vertex its new one (n,), and how many
        edges were collapsed and flipped and triangles dropped.
    """
    points, triangles = points.copy(), triangles.copy()
    stands_for = np.arange(len(points))
    count = {"collapsed": 0, "flipped": 0, "dropped": 0}
    for _ in range(PASSES):
        work = _Pass(points, triangles, parts, stands_for[kept])
        done = work.run()
        if not any(done.values()):
            break
        for name in count:
            count[name] += done[name]
        triangles, parts = triangles[~work.gone], parts[~work.gone]
        stands_for = work.stands_for[stands_for]
    return points, triangles, parts, stands_for, count


class _Pass:
    """One round over the bad triangles, worst first; each takes its neighbourhood for itself."""

    def __init__(self, points: Floats, triangles: Ints, parts: Ints, kept: Ints) -> None:
        self.points, self.triangles, self.parts = points, triangles, parts
        self.edges = edges_of(triangles)
        self.gone = np.zeros(len(triangles), dtype=bool)
        self.stands_for = np.arange(len(points))
        self.locked = np.zeros(len(points), dtype=bool)
        ends, sides = self.edges.ends, self.edges.sides
        split = (self.edges.count == 2) & (parts[sides[:, 0]] != parts[sides[:, 1]])
        size = len(points)
        named = np.isin(ends @ [size, 1], np.sort(kept, axis=1) @ [size, 1])
        self.fixed_edge = split | named | (self.edges.count == 1)
        self.fixed = np.zeros(size, dtype=bool)
        self.fixed[ends[self.fixed_edge]] = True
        self.at_border = np.zeros(size, dtype=bool)
        self.at_border[ends[self.edges.border]] = True
        self.order = np.argsort(triangles.ravel(), kind="stable")
        self.start = np.searchsorted(triangles.ravel()[self.order], np.arange(size + 1))

    def run(self) -> dict[str, int]:
        done = {"collapsed": 0, "flipped": 0, "dropped": 0}
        shape = shapes(self.points, self.triangles)
        bad = np.flatnonzero(shape < THIN)
        for t in bad[np.argsort(shape[bad], kind="stable")]:
            corners = self.triangles[t]
            near = np.unique(self.triangles[np.concatenate([self.star(v) for v in corners])])
            if self.gone[t] or self.locked[near].any():
                continue
            side = np.linalg.norm(self.points[np.roll(corners, -1)] - self.points[corners], axis=1)
            edge, opposite = int(np.argmax(side)), corners[(int(np.argmax(side)) + 2) % 3]
            if side.min() < 2 * THIN * side.max() and self.collapse(t, int(np.argmin(side))):
                done["collapsed"] += 1
            elif self.drop(t, edge, opposite):
                done["dropped"] += 1
            elif self.flip(t, edge, opposite):
                done["flipped"] += 1
            else:
                continue
            self.locked[near] = True
        return done

    def star(self, vertex: int) -> Ints:
        """Triangles around a vertex."""
        return self.order[self.start[vertex] : self.start[vertex + 1]] // 3

    def drop(self, t: int, edge: int, apex: int) -> bool:
        """Leave out a triangle whose given edge is a border, if that tears nothing apart."""
        alone = self.edges.count[self.edges.of_triangle[t]] == 1
        # With its apex on the border too, all but an ear parts what lies on its two sides.
        if not alone[edge] or (self.at_border[apex] and alone.sum() != 2):
            return False
        self.gone[t] = True
        return True

    def flip(self, t: int, edge: int, apex: int) -> bool:
        """Swap the diagonal of the two triangles at an edge, if that makes both better."""
        number = self.edges.of_triangle[t, edge]
        if self.fixed_edge[number]:
            return False
        one, two = self.edges.sides[number]
        other = one if two == t else two
        a, b = self.triangles[t, edge], self.triangles[t, (edge + 1) % 3]
        far = int(self.triangles[other].sum() - a - b)
        if np.any(self.triangles[self.star(far)] == apex):
            return False
        new = np.array([[a, far, apex], [far, b, apex]])
        if shapes(self.points, new).min() < 2 * shapes(self.points, self.triangles[[t]])[0]:
            return False
        if np.any(normals(self.points, new) @ normals(self.points, self.triangles[[other]])[0] < 0):
            return False
        self.triangles[[t, other]] = new
        return True

    def collapse(self, t: int, edge: int) -> bool:
        """Join the ends of an edge, if neither topology nor a kept edge forbids it."""
        number = self.edges.of_triangle[t, edge]
        a, b = (int(v) for v in self.edges.ends[number])
        if self.fixed[a] and self.fixed[b] and not self.fixed_edge[number]:
            return False
        common = np.intersect1d(self.triangles[self.star(a)], self.triangles[self.star(b)])
        if len(common) != 2 + self.edges.count[number]:
            return False
        stays, goes = (b, a) if self.fixed[b] and not self.fixed[a] else (a, b)
        place = self.points[stays].copy()
        if self.fixed[a] == self.fixed[b] and not self.fixed[a]:
            place = self.points[[a, b]].mean(axis=0)
        ring = np.union1d(self.star(a), self.star(b))
        lost = ring[np.isin(self.triangles[ring], [a, b]).sum(axis=1) == 2]
        ring = np.setdiff1d(ring, lost)
        new = np.where(self.triangles[ring] == goes, stays, self.triangles[ring])
        before, proper = (
            normals(self.points, self.triangles[ring]),
            shapes(self.points, self.triangles[ring]) > THIN,
        )
        old = self.points[stays].copy()
        self.points[stays] = place
        turned = np.einsum("ij,ij->i", before, normals(self.points, new)) <= 0
        if np.any(turned & proper):
            self.points[stays] = old
            return False
        self.triangles[ring] = new
        self.gone[lost] = True
        self.stands_for[goes] = stays
        return True
