"""Pairs that a barrier keeps apart: their energy, its derivatives, and free steps."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from scipy.sparse import csc_matrix

from toros_fem.base.array_types import Floats, Ints
from toros_fem.mechanics.contact.opening import StartCheck

# Pairs are looked for within a margin, over the reach of contact: they hold until a vertex has
# moved that far.
MARGIN = 0.25
# Part of the way to a contact that a step may go.
APPROACH = 0.9


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
