"""Repair of meshes from files: copies of vertices and triangles, needles and caps."""

from __future__ import annotations

from collections import Counter

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.triangles import between, coincident, edge_keys, edges_of, normals, shapes

# Vertices closer than this fraction of the bounding box's diagonal are merged.
COINCIDENT = 1e-7
# Triangles thinner than this (height over longest edge) are repaired.
THIN = 1e-3
PASSES = 50
# Kinds of repairs, in the words and the order in which they are told.
KINDS = MERGED, DROPPED, COLLAPSED, FLIPPED, REVERSED = (
    "coincident vertices merged", "triangles dropped", "edges collapsed", "edges flipped",
    "triangles reversed",
)  # fmt: skip


def weld(points: Floats, triangles: Ints, near: float = COINCIDENT) -> tuple[Ints, Ints]:
    """Merge vertices (n, 3) at the same place, within a fraction of the size.

    Returned are for each vertex the one that replaces it, (n,), and the indices of the triangles
    that are kept: those with three different corners, each set of corners once.
    """
    reach = near * float(np.linalg.norm(np.ptp(points, axis=0)))
    place = coincident(points, reach)
    replaced_by = np.unique(place, return_index=True)[1][place]
    corners = np.sort(replaced_by[triangles], axis=1)
    first = np.unique(corners, axis=0, return_index=True)[1]
    proper = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])
    return replaced_by, np.sort(first[proper[first]])


def remove_thin(
    points: Floats, triangles: Ints, parts: Ints, kept: Ints
) -> tuple[Floats, Ints, Ints, Ints, Counter[str]]:
    """Remove triangles thinner than `THIN`, where that is simple.

    A needle's short edge is collapsed. A cap's long edge is flipped; where that edge is a border,
    the cap is dropped. The surface moves by less than `THIN` of the longest edge. A triangle
    is not changed if its repair would change the topology, fold the surface over or move a kept
    edge, one of `kept`, (k, 2), or between parts.

    Returned are points (n, 3), triangles and parts, the vertex that replaces each old one, (n,),
    and the numbers of repairs.
    """
    points, triangles = points.copy(), triangles.copy()
    replaced_by = np.arange(len(points))
    repairs: Counter[str] = Counter()
    for _ in range(PASSES):
        work = _Pass(points, triangles, parts, replaced_by[kept])
        done = work.run()
        if not done:
            break
        repairs += done
        triangles, parts = triangles[~work.gone], parts[~work.gone]
        replaced_by = work.replaced_by[replaced_by]
    return points, triangles, parts, replaced_by, repairs


class _Pass:
    """One pass over the thin triangles, the worst first.

    After a repair, its neighbourhood is not changed again in this pass.
    """

    def __init__(self, points: Floats, triangles: Ints, parts: Ints, kept: Ints) -> None:
        self.points, self.triangles, self.parts = points, triangles, parts
        self.edges = edges_of(triangles)
        self.gone = np.zeros(len(triangles), dtype=bool)
        self.replaced_by = np.arange(len(points))
        self.locked = np.zeros(len(points), dtype=bool)
        ends, size = self.edges.ends, len(points)
        named = np.isin(edge_keys(ends, size), edge_keys(kept, size))
        self.fixed_edge = between(self.edges, parts) | named | (self.edges.count == 1)
        self.fixed = np.zeros(size, dtype=bool)
        self.fixed[ends[self.fixed_edge]] = True
        self.at_border = np.zeros(size, dtype=bool)
        self.at_border[ends[self.edges.border]] = True
        self.order = np.argsort(triangles.ravel(), kind="stable")
        self.start = np.searchsorted(triangles.ravel()[self.order], np.arange(size + 1))

    def run(self) -> Counter[str]:
        """Repair each thin triangle once; return the numbers of repairs."""
        done: Counter[str] = Counter()
        shape = shapes(self.points, self.triangles)
        bad = np.flatnonzero(shape < THIN)
        for t in bad[np.argsort(shape[bad], kind="stable")]:
            corners = self.triangles[t]
            near = np.unique(self.triangles[np.concatenate([self.star(v) for v in corners])])
            if self.gone[t] or self.locked[near].any():
                continue
            side = np.linalg.norm(self.points[np.roll(corners, -1)] - self.points[corners], axis=1)
            short, long = int(np.argmin(side)), int(np.argmax(side))
            apex = corners[(long + 2) % 3]
            if side[short] < 2 * THIN * side[long] and self.collapse(t, short):
                done[COLLAPSED] += 1
            elif self.drop(t, long, apex):
                done[DROPPED] += 1
            elif self.flip(t, long, apex):
                done[FLIPPED] += 1
            else:
                continue
            self.locked[near] = True
        return done

    def star(self, vertex: int) -> Ints:
        """Return the triangles around a vertex."""
        return self.order[self.start[vertex] : self.start[vertex + 1]] // 3

    def drop(self, t: int, edge: int, apex: int) -> bool:
        """Drop a triangle at a border edge, if the surface stays connected there."""
        alone = self.edges.count[self.edges.of_triangle[t]] == 1
        # With its apex on the border too, it connects its two neighbours, unless it has only one.
        if not alone[edge] or (self.at_border[apex] and alone.sum() != 2):
            return False
        self.gone[t] = True
        return True

    def flip(self, t: int, edge: int, apex: int) -> bool:
        """Flip an edge, if both new triangles are less thin and nothing folds over."""
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
        """Merge the ends of an edge, unless topology, a fold or a kept edge forbids it."""
        number = self.edges.of_triangle[t, edge]
        a, b = (int(v) for v in self.edges.ends[number])
        fixed = self.fixed[[a, b]]
        if fixed.all() and not self.fixed_edge[number]:
            return False
        common = np.intersect1d(self.triangles[self.star(a)], self.triangles[self.star(b)])
        if len(common) != 2 + self.edges.count[number]:
            return False
        stays, goes = (b, a) if fixed[1] and not fixed[0] else (a, b)
        ring = np.union1d(self.star(a), self.star(b))
        lost = ring[np.isin(self.triangles[ring], [a, b]).sum(axis=1) == 2]
        ring = np.setdiff1d(ring, lost)
        old = self.triangles[ring]
        new = np.where(old == goes, stays, old)
        moved = self.points.copy()
        if not fixed.any():
            moved[stays] = self.points[[a, b]].mean(axis=0)
        before, after = normals(self.points, old), normals(moved, new)
        proper = shapes(self.points, old) > THIN
        if np.any((np.einsum("ij,ij->i", before, after) <= 0) & proper):
            return False
        self.points[stays], self.triangles[ring] = moved[stays], new
        self.gone[lost] = True
        self.replaced_by[goes] = stays
        return True
