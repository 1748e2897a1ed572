"""Coulomb's law at vertices, regularised by an elastic slip, with all its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.validation import require_positive


@dataclass(frozen=True, eq=False)
class Coulomb:
    """Coulomb's friction of one side of a contact, at n vertices at once.

    A vertex has the normal force N, a vector, and the motion u away from its anchor, the point of
    the other side at which it sticks. With P = I − n nᵀ and n = N/|N| the friction is

        F = μ |N| φ(g) m,   φ(g) = (2 − g/s)/s for g < s, and 1/g beyond,

    directed against the motion, with m = P u and g = |P u| where the coefficient is the same in
    all directions. s is the `slip`: below it the contact sticks elastically, beyond it slides
    under μ |N|. F is the gradient by u of μ |N| f(g), for a normal force that is held (Li et al.
    2020, eqs. 13-15, with the anchor in the place of the last positions).

    Where sliding is easier along a direction d in the ground, by a < 1, the gauge of a motion is
    g = √(|P u|² − (1 − a²) v²), v = d·u where that is positive, else 0, and m = P u − (1 − a²) v d.
    F is then still the gradient of a convex function (Goyal, Ruina & Papadopoulos 1991). The
    stiffness jumps where d·u changes its sign; n is the ground's, so that N changes its size alone.

    The elastic part of the slip, at most s long, is what a step leaves to the next: the anchor
    follows a sliding vertex at the distance s (the return mapping of plasticity; Wriggers 2006,
    section 5.2.3). A held load therefore does not creep.

    Attributes:
        friction: Coefficient μ, one or one for each vertex.
        slip: s in m, of the gauge.
        ratio: a, coefficient in the easy direction over μ, at most 1, one or one for each vertex.
        easy: d before its projection to the ground.
    """

    friction: float | Floats
    slip: float
    ratio: float | Floats = 1.0
    easy: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        require_positive(slip=self.slip)

    def at(self, normal: Floats, motion: Floats) -> FrictionAt:
        """Return the friction of normal forces N in N and motions u in m, both (n, 3)."""
        return FrictionAt(self, normal, motion)


class FrictionAt:
    """Friction and its derivatives at given normal forces and motions of n vertices."""

    def __init__(self, law: Coulomb, normal: Floats, motion: Floats) -> None:
        self._law, self._size = law, np.linalg.norm(normal, axis=1)
        self._mu, ratio = (np.broadcast_to(v, len(normal)) for v in (law.friction, law.ratio))
        self._unit = normal / np.where(self._size > 0, self._size, 1.0)[:, None]
        self._plane = np.eye(3) - _outer(self._unit, self._unit)
        self._tangential = np.einsum("nij,nj->ni", self._plane, motion)
        self._across = np.einsum("ni,ni->n", self._unit, motion)
        easy = self._plane @ np.array(law.easy)
        easy /= np.maximum(np.linalg.norm(easy, axis=1), 1e-12)[:, None]
        less = (1 - ratio**2) * (np.einsum("ni,ni->n", easy, motion) > 0)
        self._metric = self._plane - _times(less, _outer(easy, easy))
        self._along = np.einsum("nij,nj->ni", self._metric, motion)  # m
        self._gauge = np.sqrt(np.einsum("ni,ni->n", self._along, self._tangential))
        self._turns = ratio == 1  # of pads the ground's normal is fixed

    @cached_property
    def _ratio(self) -> tuple[Floats, Floats]:
        """φ in 1/m and φ'/g in 1/m³; the latter is bounded in products."""
        s, g = self._law.slip, self._gauge
        safe, slides = np.maximum(g, 1e-9 * s), g >= s
        ratio = np.where(slides, 1 / safe, (2 - g / s) / s)
        return ratio, np.where(slides, -1 / safe**3, -1 / (s**2 * safe))

    @cached_property
    def _kept(self) -> tuple[Floats, Floats]:
        """Factor that shortens the gauge to s, and its derivative over g."""
        s = self._law.slip
        longer = np.maximum(self._gauge, s)
        return s / longer, np.where(self._gauge > s, -s / longer**3, 0.0)

    def energy(self) -> Floats:
        """Return μ |N| f(g) in J, (n,), with f(0) = 0."""
        s = self._law.slip
        y = np.minimum(self._gauge / s, 1.0)
        f = s * (y**2 - y**3 / 3) + np.maximum(self._gauge - s, 0.0)
        return np.asarray(self._mu * self._size * f)

    def force(self) -> Floats:
        """Return F in N, (n, 3): the gradient of `energy` by the motion."""
        return np.asarray((self._mu * self._size * self._ratio[0])[:, None] * self._along)

    def stiffness(self) -> Floats:
        """Return ∂F/∂u in N/m, (n, 3, 3), symmetric and positive semidefinite."""
        ratio, change = self._ratio
        parts = _times(ratio, self._metric) + _times(change, _outer(self._along, self._along))
        return _times(self._mu * self._size, parts)

    def force_by_normal(self) -> Floats:
        """Return ∂F/∂N, (n, 3, 3): more or less friction, and another tangent plane."""
        ratio, change = self._ratio
        more = _outer(ratio[:, None] * self._along, self._unit)
        return _times(self._mu, more - self._turned(ratio, change))

    def elastic(self) -> Floats:
        """Return the elastic slip in m, (n, 3): P u, its gauge shortened to s.

        It has the friction of the whole motion. Without a normal force it is zero.
        """
        return np.asarray((self._kept[0] * (self._size > 0))[:, None] * self._tangential)

    def elastic_by_motion(self) -> Floats:
        """Return the derivative of `elastic` by the motion, (n, 3, 3)."""
        kept, change = self._kept
        parts = _times(kept, self._plane) + _times(change, _outer(self._tangential, self._along))
        return _times(self._size > 0, parts)

    def elastic_by_normal(self) -> Floats:
        """Return the derivative of `elastic` by N in m/N, (n, 3, 3)."""
        inverse = np.divide(1.0, self._size, out=np.zeros_like(self._size), where=self._size > 0)
        return _times(-inverse, self._turned(*self._kept))

    def _turned(self, factor: Floats, change: Floats) -> Floats:
        """Return what factor(g) P u loses where N turns, times |N|."""
        across, u = self._across, self._tangential
        parts = _times(across, self._plane) + _outer(self._unit, u)
        parts = _times(factor, parts) + _times(across * change, _outer(u, u))
        return _times(self._turns, parts)


def _times(factor: Floats, parts: Floats) -> Floats:
    """Return 3×3 matrices times a factor each."""
    return np.asarray(factor[:, None, None] * parts)


def _outer(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, :, None] * b[:, None, :])
