"""Pairs of triangulated surfaces, by the IPC Toolkit."""

from __future__ import annotations

from typing import Any, override

import numpy as np
from scipy.sparse import csc_matrix

from toros_fem.base.array_types import Floats, Ints
from toros_fem.mechanics.contact.library import collision_mesh, ipctk
from toros_fem.mechanics.contact.opening import StartCheck, check_start
from toros_fem.mechanics.contact.pair_set import APPROACH, MARGIN, PairSet, thirds
from toros_fem.mechanics.contact.settings import ContactSizes

# Number of pairs to a triangle up to which a list for a way is kept.
CROWDED = 4


class SurfacePairs(PairSet):
    """Pairs of triangulated surfaces.

    Args:
        rest: Vertices in m, (n, 3), by whose edges nearly parallel pairs are smoothed.
        triangles: Triangles of all surfaces, (m, 3).
        areas: Area of each triangle in m², (m,): that of its flat panel.
        sizes: Numbers of the contact.
        may_touch: Filter of pairs of vertices, of the toolkit's own kind; None takes all.
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
        """Find the pairs in contact."""
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
