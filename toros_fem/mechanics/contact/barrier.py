"""Barrier between a skin, bodies and half-spaces: a sum over sets of pairs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.mechanics.contact.free_bodies import FreeBodies
from toros_fem.mechanics.contact.library import patches_apart
from toros_fem.mechanics.contact.neighbours import (
    collision_filter,
    leaving_out,
    neighbours,
    sizes_between_neighbours,
)
from toros_fem.mechanics.contact.pair_sets import HalfSpacePairs, PairSet, SurfacePairs, thirds
from toros_fem.mechanics.contact.settings import Contact, ContactSizes
from toros_fem.meshes.pattern import Pattern


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
        contact: Contact,
        sizes: ContactSizes,
        prescribed: Bools,
        bodies: FreeBodies,
        *,
        by_side: bool,
    ) -> None:
        self._pattern, self._contact, self._sizes = pattern, contact, sizes
        self._count, self._bodies = len(pattern.points), bodies
        counts = [self._count, *bodies.counts]
        self._owners = np.repeat(np.arange(len(counts)), counts)  # 0 for the skin
        made = bodies.vertices(np.zeros((len(contact.bodies), 6)))
        self._rest = np.concatenate([pattern.points, made])
        self._triangles = np.concatenate([pattern.triangles, bodies.triangles + self._count])
        self._areas = np.concatenate([pattern.areas, bodies.areas])
        near: Ints = np.zeros((0, 2), dtype=np.int64)
        if contact.self_contact:
            near = neighbours(pattern, sizes)
        every = collision_filter(
            self._count,
            prescribed=prescribed,
            bodies=bodies.counts,
            free_bodies=contact.free_bodies,
            self_contact=contact.self_contact,
        )
        self._may_touch = every & leaving_out(near)
        self._apart = list(self.sides if by_side else self._grounds)
        others, more = self._may_touch, bool(contact.bodies)
        if by_side:
            others = ~patches_apart(self._owners == 0) & others
            more = bool(contact.free_bodies) and len(contact.bodies) > 1
        if contact.self_contact or more:
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
            HalfSpacePairs(ground, standing, areas, self._sizes) for ground in self._contact.grounds
        ]

    @cached_property
    def sides(self) -> list[PairSet]:
        """Pairs of the skin and each half-space, then each body."""
        # What leaves out most pairs comes first: those within the skin.
        skin = patches_apart(self._owners == 0) & self._may_touch
        bodies = [
            self._surfaces(self._sizes, patches_apart(self._owners == body) & skin)
            for body in range(1, 1 + len(self._contact.bodies))
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
        names = [body.name for body in self._contact.bodies]
        owners = [names[k - 1] for k in self._owners[self._count :]]
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
