"""Barriers between surfaces: pairs in contact, their energy and derivatives, free steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from toros_fem.base.array_types import Floats, Ints
from toros_fem.mechanics.contact.library import ipctk
from toros_fem.mechanics.contact.opening import StartCheck, check_start
from toros_fem.mechanics.contact.settings import ContactSizes, Ground

# Pairs are looked for within a margin, over the reach of contact: they hold until a vertex has
# moved that far.
MARGIN = 0.25
# Number of pairs to a triangle up to which a list for a way is kept.
CROWDED = 4
# Part of the way to a contact that a step may go.
APPROACH = 0.9


class Side:
    """A part of the pairs in contact at one state: those with one half-space or one surface.

    Args:
        potential, mesh, pairs: The toolkit's potential, its mesh, and its pairs.
        vertices: Vertices of the mesh among all, (m,).
        x: All vertices in m, (n, 3).
    """

    def __init__(self, potential: Any, mesh: Any, pairs: Any, vertices: Ints, x: Floats) -> None:
        self._potential, self._mesh, self._pairs = potential, mesh, pairs
        self._vertices, self._at, self._count = vertices, np.asfortranarray(x[vertices]), len(x)
        self._hessian: Any = None

    def push(self) -> Floats:
        """Return the force in N by which the barrier pushes at all vertices, (n, 3)."""
        out: Floats = np.zeros((self._count, 3))
        if len(self._pairs):
            gradient = self._potential.gradient(self._pairs, self._mesh, self._at)
            out[self._vertices] = -gradient.reshape(-1, 3)
        return out

    def push_change(self, motion: Floats) -> Floats:
        """Return the change of `push` in N by a small motion of all vertices, (n, 3) in m.

        It is its own transpose.
        """
        out: Floats = np.zeros((self._count, 3))
        if len(self._pairs):
            if self._hessian is None:
                self._hessian = self._potential.hessian(self._pairs, self._mesh, self._at)
            own = motion[self._vertices].ravel()
            out[self._vertices] = -(self._hessian @ own).reshape(-1, 3)
        return out


class Barrier:
    """Barrier between triangulated surfaces, and between their vertices and half-spaces.

    The energy of a pair at the distance d of its faces is its area times κ δ̂ b(d/δ̂), b the
    clamped logarithm of incremental potential contact in its form with units (Li et al. 2020,
    eq. 6; Li et al. 2023). It belongs to one process: `SkinContact` shares it.

    Args:
        rest: Vertices in m, (n, 3), by whose edges nearly parallel pairs are smoothed.
        triangles: Triangles of all surfaces, (m, 3).
        areas: Area of each triangle in m², (m,): that of its flat panel.
        grounds: Half-spaces, already moved to where middle surfaces must stay out.
        grounded: Vertices that half-spaces keep out, (g,).
        sizes: Numbers of the contact.
        may_touch: Filter of pairs of vertices, of the toolkit's own kind; None takes all.
        further: Another barrier of the same vertices that acts too, that of neighbours in the
            sheet; None for none.
    """

    def __init__(
        self,
        rest: Floats,
        triangles: Ints,
        areas: Floats,
        grounds: Sequence[Ground],
        grounded: Ints,
        sizes: ContactSizes,
        may_touch: Any = None,
        further: Barrier | None = None,
    ) -> None:
        ipc = ipctk()
        self._further = further
        self._ipc, self._sizes = ipc, sizes
        faces = np.asfortranarray(triangles, dtype=np.int32)
        corners = np.asfortranarray(rest)
        self._mesh = ipc.CollisionMesh(corners, ipc.edges(faces), faces)
        by_vertex = np.bincount(triangles.ravel(), np.repeat(areas / 3, 3), len(rest))
        self._mesh.vertex_areas = by_vertex
        self._edges, self._faces = self._mesh.edges, self._mesh.faces
        edges = np.asarray(self._mesh.faces_to_edges)
        self._mesh.edge_areas = np.bincount(
            edges.ravel(), np.repeat(areas / 3, 3), self._mesh.num_edges
        )
        if may_touch is not None:
            self._mesh.can_collide = may_touch
        self._pairs, self._wide = self._pair_set(), self._pair_set()
        self._potential = ipc.BarrierPotential(sizes.distance, sizes.stiffness, True)
        self._margin = MARGIN * sizes.reach
        wide = sizes.distance + 2 * self._margin
        self._wide_distance = wide
        self._wide_potential = ipc.BarrierPotential(wide, sizes.stiffness, True)
        self._ccd = ipc.AdditiveCCD(conservative_rescaling=APPROACH)
        self._candidates = ipc.Candidates()
        self._divided: tuple[Any, list[Any]] | None = None  # by the other surface
        # Begin of the straight way that the pairs are listed for, and the way itself.
        self._way: tuple[Floats, Floats] | None = None
        self._at: Floats | None = None

        # The toolkit keeps no thickness from planes: they have a mesh of bare vertices.
        self._grounds, self._grounded = grounds, grounded
        self._points = None
        self._planes = [ipc.Hyperplane(np.array(g.normal), np.array(g.point)) for g in grounds]
        if grounds:
            self._points = ipc.CollisionMesh(np.asfortranarray(rest[grounded]))
            self._points.vertex_areas = by_vertex[grounded]
            alike = np.zeros(len(grounded), dtype=np.int32)
            self._points.can_collide = ipc.make_vertex_patches_filter(alike)
            self._points.planes = self._planes
        self._standing, self._wide_standing = self._pair_set(), self._pair_set()
        self._places = (3 * grounded[:, None] + np.arange(3)).ravel()

    def _pair_set(self) -> Any:
        pairs = self._ipc.NormalCollisions()
        pairs.use_area_weighting = True
        return pairs

    def place(self, x: Floats) -> None:
        """Find the pairs in contact at vertices x, (n, 3) in m."""
        if self._at is not None and np.array_equal(self._at, x):
            return
        self._at = x.copy()
        if self._further is not None:
            self._further.place(x)
        if not self._listed(x):
            self._way = self._at, np.zeros_like(x)
            self._candidates = self._ipc.Candidates()
            self._candidates.build(self._mesh, x, self._sizes.reach / 2 + self._margin)
        thickness, distance = self._sizes.thickness, self._sizes.distance
        self._pairs.build(self._candidates, self._mesh, x, distance, thickness)
        self._stand(self._standing, x, distance)

    def _listed(self, x: Floats) -> bool:
        """Return whether the list of pairs serves vertices x: they are near the way it is for."""
        if self._way is None:
            return False
        begin, way = self._way
        off = x - begin
        square = float(np.vdot(way, way))
        if square > 0:
            off -= min(max(float(np.vdot(off, way)) / square, 0.0), 1.0) * way
        return bool(np.abs(off).max() <= self._margin / 2)

    def _stand(self, standing: Any, x: Floats, distance: float) -> None:
        """Find the vertices that are nearer to a half-space than a distance."""
        if self._points is None:
            return
        # The toolkit's own search inflates each vertex by half the distance, and planes by nothing.
        candidates = self._ipc.Candidates()
        candidates.pv_candidates = [
            self._ipc.PlaneVertexCandidate(plane, int(vertex))
            for plane, height in zip(self._planes, self._heights(x), strict=True)
            for vertex in np.flatnonzero(height < distance)
        ]
        standing.build(candidates, self._points, x[self._grounded], distance, 0.0)

    def gap(self, x: Floats) -> float:
        """Return the smallest distance of faces in m, at most that from which on contact acts.

        It is zero or less where surfaces are too near to each other. Neighbours do not count.
        """
        self.place(x)
        least = self._sizes.distance
        if len(self._pairs):
            square = self._pairs.compute_minimum_distance(self._mesh, x)
            least = min(least, float(np.sqrt(square)) - self._sizes.thickness)
        return min(least, *(float(h.min(initial=np.inf)) for h in self._heights(x)), np.inf)

    def _heights(self, x: Floats) -> list[Floats]:
        """Return the heights of the vertices above each half-space in m."""
        at = x[self._grounded]
        return [(at - np.array(g.point)) @ np.array(g.normal) for g in self._grounds]

    @property
    def count(self) -> int:
        """Number of pairs in contact."""
        found = len(self._pairs) + (len(self._standing) if self._points is not None else 0)
        return found + (0 if self._further is None else self._further.count)

    def energy(self, x: Floats) -> float:
        """Return the energy in J; infinite where surfaces are too near to each other."""
        self.place(x)
        if any((height <= 0).any() for height in self._heights(x)):
            return np.inf
        found = float(self._potential(self._pairs, self._mesh, x)) if len(self._pairs) else 0.0
        if self._points is not None and len(self._standing):
            found += float(self._potential(self._standing, self._points, x[self._grounded]))
        return found + (0.0 if self._further is None else self._further.energy(x))

    def gradient(self, x: Floats) -> Floats:
        """Return the first variation of the energy in N, (n, 3)."""
        self.place(x)
        out: Floats = np.zeros(x.size)
        if len(self._pairs):
            out += self._potential.gradient(self._pairs, self._mesh, x)
        out = out.reshape(-1, 3)
        if self._points is not None and len(self._standing):
            at = x[self._grounded]
            part = self._potential.gradient(self._standing, self._points, at)
            out[self._grounded] += part.reshape(-1, 3)
        return out if self._further is None else out + self._further.gradient(x)

    def hessian(self, x: Floats, *, definite: bool = False) -> csc_matrix:
        """Return the second variation in N/m, (3 n, 3 n).

        Args:
            x: Vertices in m, (n, 3).
            definite: Whether to make that of each pair positive semidefinite.
        """
        self.place(x)
        method = self._ipc.PSDProjectionMethod
        projection = method.CLAMP if definite else method.NONE
        own = self._sum(self._potential, self._pairs, self._standing, x, projection)
        return own if self._further is None else own + self._further.hessian(x, definite=definite)

    def near(self, x: Floats) -> csc_matrix:
        """Return a matrix with an entry wherever `hessian` has one within the margin."""
        self.place(x)
        thickness, distance = self._sizes.thickness, self._wide_distance
        self._wide.build(self._candidates, self._mesh, x, distance, thickness)
        self._stand(self._wide_standing, x, distance)
        none = self._ipc.PSDProjectionMethod.NONE
        own = self._sum(self._wide_potential, self._wide, self._wide_standing, x, none)
        return own if self._further is None else own + self._further.near(x)

    def sides(self, x: Floats, owners: Ints) -> list[Side]:
        """Return the contact of the first surface with each half-space, then each other surface.

        Args:
            x: Vertices in m, (n, 3).
            owners: Surface of each vertex, (n,), counted from 0.
        """
        self.place(x)
        by_ground: list[list[Any]] = [[] for _ in self._grounds]
        for pair in self._standing.pv_collisions if self._points is not None else ():
            by_ground[self._ground_of(pair)].append(pair)
        sides = []
        for pairs in by_ground:
            part = self._pair_set()
            part.pv_collisions = pairs
            sides.append(Side(self._potential, self._points, part, self._grounded, x))
        everything = np.arange(len(x))
        for candidates in self._candidates_by_surface(owners):
            part = self._pair_set()
            part.build(candidates, self._mesh, x, self._sizes.distance, self._sizes.thickness)
            sides.append(Side(self._potential, self._mesh, part, everything, x))
        return sides

    def _candidates_by_surface(self, owners: Ints) -> list[Any]:
        """Return the listed pairs of the first surface with each other one.

        A list serves many states, and is divided once: pairs are objects of Python here.
        """
        if self._divided is None or self._divided[0] is not self._candidates:
            count, surface = int(owners.max(initial=0)), [int(k) for k in owners]
            parts = [self._ipc.Candidates() for _ in range(count)]
            for kind in ("ee_candidates", "fv_candidates") if count else ():
                chosen: list[list[Any]] = [[] for _ in range(count)]
                for pair in getattr(self._candidates, kind):
                    met = {surface[v] for v in pair.vertex_ids(self._edges, self._faces) if v >= 0}
                    if len(met) == 2 and 0 in met:
                        chosen[sum(met) - 1].append(pair)
                for part, pairs in zip(parts, chosen, strict=True):
                    setattr(part, kind, pairs)
            self._divided = self._candidates, parts
        return self._divided[1]

    def _ground_of(self, pair: Any) -> int:
        """Return the number of the half-space of a pair."""
        if len(self._grounds) == 1:
            return 0
        normal, origin = pair.plane.normal(), pair.plane.origin()
        off = [
            np.abs(np.array(g.normal) - normal).sum()
            + abs(np.array(g.normal) @ (origin - g.point)) / self._sizes.distance
            for g in self._grounds
        ]
        return int(np.argmin(off))

    def _sum(
        self, potential: Any, pairs: Any, standing: Any, x: Floats, projection: Any
    ) -> csc_matrix:
        out = csc_matrix((x.size, x.size))
        if len(pairs):
            out = potential.hessian(pairs, self._mesh, x, projection)
        if self._points is not None and len(standing):
            part = potential.hessian(standing, self._points, x[self._grounded], projection).tocoo()
            places = self._places[part.row], self._places[part.col]
            out = out + csc_matrix((part.data, places), shape=out.shape)
        return out

    def largest_step(self, x: Floats, step: Floats) -> float:
        """Return a factor ≤ 1 on a step of the vertices, so that nothing meets on the way.

        Of the way to the first contact it leaves the part that `APPROACH` does not allow.

        Args:
            x: Vertices in m, (n, 3), apart from each other.
            step: Their straight motion in m, (n, 3).
        """
        self.place(x)
        factor = 1.0
        for height, ground in zip(self._heights(x), self._grounds, strict=True):
            sinking = -(step[self._grounded] @ np.array(ground.normal))
            down = sinking > 0
            factor = min(factor, float((APPROACH * height[down] / sinking[down]).min(initial=1.0)))
        candidates, way = self._candidates, factor * step
        if not self._listed(x + way):
            candidates = self._ipc.Candidates()
            candidates.build(self._mesh, x, x + way, self._sizes.reach / 2 + self._margin)
            if len(candidates) <= CROWDED * len(self._faces):  # it serves what is tried on the way
                self._candidates, self._way = candidates, (x.copy(), way)
        if len(candidates):
            factor *= float(
                candidates.compute_collision_free_stepsize(
                    self._mesh, x, x + factor * step, self._sizes.thickness, self._ccd
                )
            )
        if self._further is None:
            return factor
        return factor * self._further.largest_step(x, factor * step)

    def check(self, x: Floats) -> StartCheck:
        """Return whether vertices x, (n, 3) in m, may be a start, and the worst place if not."""
        thickness = self._sizes.thickness
        return check_start(self._mesh, x, thickness, grounds=self._grounds, grounded=self._grounded)

    def crossed(self, x: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""
        below = any((height <= 0).any() for height in self._heights(x))
        if below or self._ipc.has_intersections(self._mesh, x):
            return True
        return self._further is not None and self._further.crossed(x)
