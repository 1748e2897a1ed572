"""Test of the stretches that eq. (1) admits, and limit of a step by them."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from toros_fem._mpi import largest, smallest
from toros_fem._types import Floats

# Below this smaller stretch a triangle counts as collapsed: there det C is not smooth.
COLLAPSED = 1e-6


def singular_values(edges: Floats) -> tuple[Floats, Floats]:
    """Return the larger and the smaller singular value of 3×2 matrices, shape (n, 3, 2)."""
    (a, b, c), (d, e, f) = edges.T
    uu, vv, uv = a * a + b * b + c * c, d * d + e * e + f * f, a * d + b * e + c * f
    p = np.sqrt((b * f - c * e) ** 2 + (c * d - a * f) ** 2 + (a * e - b * d) ** 2)
    s = np.sqrt(uu + vv + 2 * p)
    # λ₁ − λ₂ = (λ₁² − λ₂²)/s: the difference tr C − 2p would cancel.
    difference = np.hypot(uu - vv, 2 * uv) / np.maximum(s, COLLAPSED)
    return (s + difference) / 2, (s - difference) / 2


class StretchBounds:
    """Feasibility of eq. (1), tested by the stretches themselves.

    The sign of the logarithm's argument is no test: it turns positive again far outside the bounds.

    Args:
        comm: Communicator; all methods are collective.
        flat: Flat corners of the owned triangles, (n, 3 corners, 2), in m.
        c1, c2: Bounds of eq. (1).
        wrinkles: Whether the sheet wrinkles instead of taking compression. Then only the upper
            bounds count: where it wrinkles, the natural width keeps the other ones by itself.
    """

    def __init__(
        self, comm: MPI.Comm, flat: Floats, c1: float, c2: float, *, wrinkles: bool = False
    ) -> None:
        self._comm = comm
        chart = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
        self._inverse_chart = np.ascontiguousarray(np.linalg.inv(chart).transpose(1, 2, 0))
        self._c1, self._c2 = c1, c2
        self._least = 0.0 if wrinkles else -np.inf

    def gradient(self, corners: Floats) -> Floats:
        """Return deformation gradients (n, 3, 2) from corner positions (n, 3 corners, 3)."""
        # Components first: each is then one array without gaps.
        first, second, third = np.ascontiguousarray(corners.transpose(1, 2, 0))
        (a, b), (c, d) = self._inverse_chart
        u, v = second - first, third - first
        return np.stack([u * a + v * c, u * b + v * d]).T

    def _use(self, F: Floats) -> Floats:
        """Fraction of the admissible range that each triangle uses: < 1 inside, ≥ 1 outside."""
        big, small = singular_values(F)
        strains = (np.maximum(strain, self._least) for strain in (big - 1, small - 1))
        single = np.maximum(*map(np.abs, strains)) / (self._c1 - 1)
        joint = np.maximum(big + small - 2, self._least)
        use = np.maximum(single, np.abs(joint) / (self._c2 - 1))
        return np.where(small > COLLAPSED, use, np.inf)

    def worst(self, corners: Floats) -> float:
        """Return the largest fraction of the bounds that any triangle uses: < 1 means feasible."""
        use = self.use(corners)
        # A NaN must count as outside, and `max` would let it through on some ranks only.
        return largest(self._comm, np.max(np.where(np.isfinite(use), use, np.inf), initial=0.0))

    def use(self, corners: Floats) -> Floats:
        """Return the fraction of the bounds that each triangle uses."""
        return self._use(self.gradient(corners))

    def largest_step(self, corners: Floats, direction: Floats, fraction: float) -> float:
        """Return a factor ≤ 1 on a step that keeps every triangle inside the bounds, 1 if possible.

        Every triangle keeps at least (1 − fraction) of its distance to the bounds. The upper bounds
        are convex in x, so that they also hold during the step. The lower ones are tested at its
        end only, and the energy there decides.

        Args:
            corners: Corner positions (n, 3, 3) of a feasible state.
            direction: Their change by the full step.
            fraction: Fraction of the distance to the bounds that may be used up.
        """
        F, G = self.gradient(corners), self.gradient(direction)
        use = self._use(F)
        limit = use + fraction * (1 - use)
        beyond = np.flatnonzero(~(self._use(F + G) <= limit))
        step = 1.0
        if len(beyond):
            F, G, limit = F[beyond], G[beyond], limit[beyond]
            inside: Floats = np.zeros(len(beyond))
            outside: Floats = np.ones(len(beyond))
            for _ in range(20):
                middle = (inside + outside) / 2
                good = self._use(F + middle[:, None, None] * G) <= limit
                inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
            step = float(inside.min())
        return smallest(self._comm, step)
