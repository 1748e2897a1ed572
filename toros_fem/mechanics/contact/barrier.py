"""Barrier between a skin, bodies and half-spaces: a sum over sets of pairs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, override

import numpy as np
from scipy.sparse import csc_matrix

from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.mechanics.contact.bodies import (
    FreeBodies,
    Ground,
    collision_mesh,
    ipctk,
    patches_apart,
)
from toros_fem.mechanics.contact.layers import (
    ContactSizes,
    StartCheck,
    check_start,
    collision_filter,
    leaving_out,
    neighbours,
    sizes_between_neighbours,
)
from toros_fem.meshes.pattern import Pattern

# Pairs are looked for within a margin, over the reach of contact: they hold until a vertex has
# moved that far.
MARGIN = 0.25
# Part of the way to a contact that a step may go.
APPROACH = 0.9
# Number of pairs to a triangle up to which a list for a way is kept.
CROWDED = 4


class Barrier:
    """Barrier between a skin, bodies and half-spaces, on one process.

    Everywhere x are all vertices of skin and bodies in m, (v, 3). The sides of the contact are the
    half-spaces, then the bodies: forces on the n vertices of the skin are (sides, n, 3). With
    `by_side` pairs of the skin and a body have a set of their own. Without friction `normals` is
    hardly asked, and one set of all pairs is found faster. `prescribed` tells which vertices of the
    skin are fixed as a whole, (n,).
    """

    def __init__(
        self,
        pattern: Pattern,
        grounds: Sequence[Ground],
        bodies: FreeBodies,
        sizes: ContactSizes,
        prescribed: Bools,
        *,
        self_contact: bool,
        by_side: bool,
    ) -> None:
        self._pattern, self._half_spaces, self._sizes = pattern, grounds, sizes
        self._count, self._bodies = len(pattern.points), bodies
        counts = [self._count, *bodies.counts]
        self._owners = np.repeat(np.arange(len(counts)), counts)  # 0 for the skin
        made = bodies.vertices(np.zeros((len(bodies.names), 6)))
        self._rest = np.concatenate([pattern.points, made])
        self._triangles = np.concatenate([pattern.triangles, bodies.triangles + self._count])
        self._areas = np.concatenate([pattern.areas, bodies.areas])
        near: Ints = np.zeros((0, 2), dtype=np.int64)
        if self_contact:
            near = neighbours(pattern, sizes)
        every = collision_filter(prescribed, bodies.counts, bodies.free, self_contact=self_contact)
        self._may_touch = every & leaving_out(near)
        self._apart = list(self.sides if by_side else self._grounds)
        others, more = self._may_touch, bool(bodies.names)
        if by_side:
            others = ~patches_apart(self._owners == 0) & others
            more = bodies.count > 0 and len(bodies.names) > 1
        if self_contact or more:
            self._apart.append(self._surfaces(sizes, others))
        self._sets = self._apart
        if len(near):  # which cannot keep a thickness apart
            closer = sizes_between_neighbours(pattern, sizes)
            self._sets = [*self._apart, self._surfaces(closer, every)]

    def _surfaces(self, sizes: ContactSizes, may_touch: Any) -> SurfacePairs:
        return SurfacePairs(self._rest, self._triangles, self._areas, sizes, may_touch)

    @cached_property
    def _grounds(self) -> list[PairSet]:
        standing = np.append(np.arange(self._count), self._count + self._bodies.moving)
        areas = thirds(self._triangles, self._areas, len(self._rest))[standing]
        return [
            HalfSpacePairs(ground, standing, areas, self._sizes) for ground in self._half_spaces
        ]

    @cached_property
    def sides(self) -> list[PairSet]:
        """Pairs of the skin and each half-space, then each body."""
        # What leaves out most pairs comes first: those within the skin.
        skin = patches_apart(self._owners == 0) & self._may_touch
        bodies = [
            self._surfaces(self._sizes, patches_apart(self._owners == body) & skin)
            for body in range(1, 1 + len(self._bodies.names))
        ]
        return [*self._grounds, *bodies]

    def energy(self, x: Floats) -> float:
        """Return the energy in J; infinite where surfaces are too near to each other."""
        return sum(pairs.energy(x) for pairs in self._sets)

    def gradient(self, x: Floats) -> Floats:
        """Return the first variation of the energy in N, (v, 3)."""
        return np.sum([pairs.gradient(x) for pairs in self._sets], axis=0)

    def hessian(self, x: Floats, *, definite: bool = False) -> csc_matrix:
        """Return the second variation in N/m, (3 v, 3 v), or a positive semidefinite part."""
        return _summed([pairs.hessian(x, definite=definite) for pairs in self._sets])

    def near(self, x: Floats) -> csc_matrix:
        """Return a matrix with an entry wherever `hessian` has one within the margin."""
        return _summed([pairs.near(x) for pairs in self._sets])

    def gap(self, x: Floats) -> float:
        """Return the smallest distance of faces in m, at most that from which on contact acts.

        It is zero or less where surfaces are too near to each other. Neighbours do not count.
        """
        return min(self._sizes.distance, *(pairs.gap(x) for pairs in self._apart))

    def count(self, x: Floats) -> int:
        """Return the number of pairs in contact."""
        return sum(pairs.count(x) for pairs in self._sets)

    def largest_step(self, x: Floats, step: Floats) -> float:
        """Return a factor ≤ 1 on a straight step, so that nothing meets on the way."""
        factor = 1.0
        for pairs in self._sets:
            factor *= pairs.largest_step(x, factor * step)
        return factor

    def refusal(self, x: Floats) -> str | None:
        """Return why vertices can be no start: the worst place, in words."""
        checks = [pairs.check(x) for pairs in self._apart]
        worst = min(checks, key=lambda found: (found.admissible, not found.ground, found.distance))
        owners = [self._bodies.names[k - 1] for k in self._owners[self._count :]]
        return None if worst.admissible else worst.sentence(self._pattern, x, owners)

    def crossed(self, x: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""
        return any(pairs.crossed(x) for pairs in self._sets)

    def normals(self, x: Floats) -> Floats:
        """Return the normal forces on the skin in N, (sides, n, 3)."""
        return -np.array([side.gradient(x)[: self._count] for side in self.sides])

    def normals_change(self, x: Floats, motion: Floats) -> Floats:
        """Return the change of `normals` by a small motion of all vertices, (v, 3)."""
        changes = [(side.hessian(x) @ motion.ravel()).reshape(-1, 3) for side in self.sides]
        return -np.array(changes)[:, : self._count]

    def normals_backward(self, x: Floats, weights: Floats) -> Floats:
        """Return the derivative of Σ weights · `normals` by all vertices, (v, 3)."""
        whole = np.zeros(x.size)
        for side, part in zip(self.sides, weights, strict=True):
            given = np.zeros(x.size)
            given[: part.size] = part.ravel()
            whole -= side.hessian(x) @ given
        return whole.reshape(-1, 3)


def _summed(matrices: Sequence[csc_matrix]) -> csc_matrix:
    """Return the sum of matrices; those of sets without pairs have no entries."""
    filled = [matrix for matrix in matrices if matrix.nnz] or matrices[:1]
    return sum(filled[1:], filled[0])


class PairSet(ABC):
    """Pairs that a barrier keeps apart: of surfaces, or of vertices and a half-space.

    The energy of a pair at the distance d of its faces is its area times κ δ̂ b(d/δ̂), b the
    clamped logarithm of incremental potential contact in its form with units (Li et al. 2020,
    eq. 6; Li et al. 2023). x are all vertices in m, (n, 3). Sets belong to one process.
    """

    @abstractmethod
    def count(self, x: Floats) -> int:
        """Return the number of pairs in contact."""

    @abstractmethod
    def gap(self, x: Floats) -> float:
        """Return the smallest distance of faces in m of pairs in contact; infinite without any.

        It is zero or less where surfaces are too near to each other.
        """

    @abstractmethod
    def energy(self, x: Floats) -> float:
        """Return the energy in J; infinite where surfaces are too near to each other."""

    @abstractmethod
    def gradient(self, x: Floats) -> Floats:
        """Return the first variation of the energy in N, (n, 3)."""

    @abstractmethod
    def hessian(self, x: Floats, *, definite: bool = False) -> csc_matrix:
        """Return the second variation in N/m, (3 n, 3 n), or a positive semidefinite part."""

    @abstractmethod
    def near(self, x: Floats) -> csc_matrix:
        """Return a matrix with an entry wherever `hessian` has one within the margin."""

    @abstractmethod
    def largest_step(self, x: Floats, step: Floats) -> float:
        """Return a factor ≤ 1 on a step of the vertices, so that nothing meets on the way.

        Of the way to the first contact it leaves the part that `APPROACH` does not allow.
        """

    @abstractmethod
    def check(self, x: Floats) -> StartCheck:
        """Return whether vertices may be a start, and the worst place if not."""

    @abstractmethod
    def crossed(self, x: Floats) -> bool:
        """Return whether surfaces intersect, by a test of its own."""


def thirds(corners: Ints, areas: Floats, count: int) -> Floats:
    """Return the area in m² of each corner or edge, (count,): a third of each of its triangles."""
    return np.asarray(np.bincount(corners.ravel(), np.repeat(areas / 3, 3), count))


class HalfSpacePairs(PairSet):
    """Pairs of vertices, (k,), and a half-space, whose distance is that of the sheet's lower face.

    The barrier is that of the toolkit, which keeps no thickness from planes.
    """

    def __init__(self, ground: Ground, vertices: Ints, areas: Floats, sizes: ContactSizes) -> None:
        self._normal = np.array(ground.normal)
        self._point = np.array(ground.point) + sizes.thickness / 2 * self._normal
        self._vertices, self._distance = vertices, sizes.distance
        self._wide_distance = sizes.distance + 2 * MARGIN * sizes.reach
        self._weights = areas * sizes.stiffness * sizes.distance
        self._both = np.outer(self._normal, self._normal)

    def _heights(self, x: Floats) -> Floats:
        return np.asarray((x[self._vertices] - self._point) @ self._normal)

    def _touching(self, x: Floats) -> tuple[Bools, Floats]:
        """Return which vertices touch, and the squares of their heights over the distance."""
        height = self._heights(x)
        near = height < self._distance
        return near, np.square(height[near] / self._distance)

    @override
    def count(self, x: Floats) -> int:
        return int((self._heights(x) < self._distance).sum())

    @override
    def gap(self, x: Floats) -> float:
        return float(self._heights(x).min(initial=np.inf))

    @override
    def energy(self, x: Floats) -> float:
        if self.crossed(x):
            return np.inf
        near, s = self._touching(x)
        return float(self._weights[near] @ _barrier(s)[0])

    @override
    def gradient(self, x: Floats) -> Floats:
        near, s = self._touching(x)
        slope = self._weights[near] * _barrier(s)[1] * 2 * np.sqrt(s) / self._distance
        out: Floats = np.zeros(x.shape)
        out[self._vertices[near]] = slope[:, None] * self._normal
        return out

    @override
    def hessian(self, x: Floats, *, definite: bool = False) -> csc_matrix:
        # The energy is convex in the height.
        near, s = self._touching(x)
        _, first, second = _barrier(s)
        by_height = (4 * s * second + 2 * first) / self._distance**2
        return self._matrix(x, near, np.asarray(self._weights[near] * by_height))

    @override
    def near(self, x: Floats) -> csc_matrix:
        within = self._heights(x) < self._wide_distance
        return self._matrix(x, within, np.ones(within.sum()))

    def _matrix(self, x: Floats, near: Bools, stiffness: Floats) -> csc_matrix:
        """Return a matrix with stiffness in N/m along the normal at some vertices."""
        i, j = np.nonzero(self._both)
        first = 3 * self._vertices[near][:, None]
        places = np.broadcast_arrays(first + i, first + j)
        values = stiffness[:, None] * self._both[i, j]
        rows, columns = (place.ravel() for place in places)
        return csc_matrix((values.ravel(), (rows, columns)), shape=(x.size, x.size))

    @override
    def largest_step(self, x: Floats, step: Floats) -> float:
        height, sinking = self._heights(x), -step[self._vertices] @ self._normal
        down = sinking > 0
        return float((APPROACH * height[down] / sinking[down]).min(initial=1.0))

    @override
    def check(self, x: Floats) -> StartCheck:
        height = self._heights(x)
        lowest = int(np.argmin(height))
        low = float(height[lowest])
        if low > 0:
            return StartCheck(True, low)
        return StartCheck(False, low, (int(self._vertices[lowest]),), ground=True)

    @override
    def crossed(self, x: Floats) -> bool:
        return bool((self._heights(x) <= 0).any())


def _barrier(s: Floats) -> tuple[Floats, Floats, Floats]:
    """Return −(s − 1)² ln s with its first and second derivative."""
    log, more = np.log(s), (1 - s) / s
    return -((1 - s) ** 2) * log, (1 - s) * (2 * log - more), more * (4 + more) - 2 * log


class SurfacePairs(PairSet):
    """Pairs of triangulated surfaces, (m, 3), with the areas of their flat panels in m², (m,).

    By the edges at rest, of vertices (n, 3) in m, nearly parallel pairs are smoothed. `may_touch`
    is a filter of pairs of vertices, of the toolkit's own kind; None takes all.
    """

    def __init__(
        self,
        rest: Floats,
        triangles: Ints,
        areas: Floats,
        sizes: ContactSizes,
        may_touch: Any = None,
    ) -> None:
        self._ipc, self._sizes = ipctk(), sizes
        self._mesh = mesh = collision_mesh(rest, triangles, may_touch)
        mesh.vertex_areas = thirds(triangles, areas, len(rest))
        mesh.edge_areas = thirds(np.asarray(mesh.faces_to_edges), areas, mesh.num_edges)
        self._margin = MARGIN * sizes.reach
        self._wide_distance = sizes.distance + 2 * self._margin
        self._pairs, self._wide = self._ipc.NormalCollisions(), self._ipc.NormalCollisions()
        self._pairs.use_area_weighting = self._wide.use_area_weighting = True
        self._potential, self._wide_potential = (
            self._ipc.BarrierPotential(distance, sizes.stiffness, True)
            for distance in (sizes.distance, self._wide_distance)
        )
        self._ccd = self._ipc.AdditiveCCD(conservative_rescaling=APPROACH)
        self._candidates = self._ipc.Candidates()
        # Begin of the straight way that the candidates are listed for, and the way itself.
        self._way: tuple[Floats, Floats] | None = None
        self._at: Floats | None = None
        self._exact: csc_matrix | None = None  # second variation there

    def _place(self, x: Floats) -> None:
        if self._at is not None and np.array_equal(self._at, x):
            return
        self._at, self._exact = x.copy(), None
        if not self._listed(x):
            self._way = self._at, np.zeros_like(x)
            self._candidates = self._ipc.Candidates()
            self._candidates.build(self._mesh, x, self._sizes.reach / 2 + self._margin)
        self._build(self._pairs, x, self._sizes.distance)

    def _build(self, pairs: Any, x: Floats, distance: float) -> None:
        pairs.build(self._candidates, self._mesh, x, distance, self._sizes.thickness)

    def _listed(self, x: Floats) -> bool:
        """Return whether the candidates serve vertices x: they are near the way they are for."""
        if self._way is None:
            return False
        begin, way = self._way
        off = x - begin
        square = float(np.vdot(way, way))
        if square > 0:
            off -= min(max(float(np.vdot(off, way)) / square, 0.0), 1.0) * way
        return bool(np.abs(off).max() <= self._margin / 2)

    @override
    def count(self, x: Floats) -> int:
        self._place(x)
        return len(self._pairs)

    @override
    def gap(self, x: Floats) -> float:
        if not self.count(x):
            return np.inf
        square = self._pairs.compute_minimum_distance(self._mesh, x)
        return float(np.sqrt(square)) - self._sizes.thickness

    @override
    def energy(self, x: Floats) -> float:
        return float(self._potential(self._pairs, self._mesh, x)) if self.count(x) else 0.0

    @override
    def gradient(self, x: Floats) -> Floats:
        if not self.count(x):
            return np.zeros(x.shape)
        found = self._potential.gradient(self._pairs, self._mesh, x)
        return np.asarray(found.reshape(-1, 3))

    @override
    def hessian(self, x: Floats, *, definite: bool = False) -> csc_matrix:
        self._place(x)
        if definite:
            return self._second(self._potential, self._pairs, x, definite=True)
        if self._exact is None:
            self._exact = self._second(self._potential, self._pairs, x)
        return self._exact

    @override
    def near(self, x: Floats) -> csc_matrix:
        self._place(x)
        self._build(self._wide, x, self._wide_distance)
        return self._second(self._wide_potential, self._wide, x)

    def _second(
        self, potential: Any, pairs: Any, x: Floats, *, definite: bool = False
    ) -> csc_matrix:
        if not len(pairs):
            return csc_matrix((x.size, x.size))
        method = self._ipc.PSDProjectionMethod
        return potential.hessian(pairs, self._mesh, x, method.CLAMP if definite else method.NONE)

    @override
    def largest_step(self, x: Floats, step: Floats) -> float:
        self._place(x)
        candidates = self._candidates
        if not self._listed(x + step):
            candidates = self._ipc.Candidates()
            candidates.build(self._mesh, x, x + step, self._sizes.reach / 2 + self._margin)
            if len(candidates) <= CROWDED * len(self._mesh.faces):  # for what is tried on the way
                self._candidates, self._way = candidates, (x.copy(), step)
        if not len(candidates):
            return 1.0
        thickness = self._sizes.thickness
        return float(
            candidates.compute_collision_free_stepsize(
                self._mesh, x, x + step, thickness, self._ccd
            )
        )

    @override
    def check(self, x: Floats) -> StartCheck:
        return check_start(self._mesh, x, self._sizes.thickness)

    @override
    def crossed(self, x: Floats) -> bool:
        return bool(self._ipc.has_intersections(self._mesh, x))
