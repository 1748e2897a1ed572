"""Barrier between vertices and a half-space."""

from __future__ import annotations

from typing import override

import numpy as np
from scipy.sparse import csc_matrix

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.mechanics.contact.opening import StartCheck
from toros_fem.mechanics.contact.pair_set import APPROACH, MARGIN, PairSet
from toros_fem.mechanics.contact.settings import ContactSizes, Ground


class HalfSpacePairs(PairSet):
    """Pairs of vertices and a half-space, whose distance is that of the sheet's lower face.

    The barrier is that of the toolkit, which keeps no thickness from planes.

    Args:
        ground: The half-space.
        vertices: Vertices that it keeps out, (k,).
        areas: Their areas in m², (k,).
        sizes: Numbers of the contact.
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
