"""Coulomb's law at vertices, regularised by an elastic slip, with all its derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.validation import require_positive


@dataclass(frozen=True)
class Coulomb:
    """Coulomb's friction of one side of a contact, at n vertices at once.

    A vertex has the normal force N, a vector, and the motion u away from its anchor, the point of
    the other side at which it sticks. With P = I − n nᵀ, n = N/|N| and y = |P u| the friction is

        F = μ |N| φ(y) P u,   φ(y) = (2 − y/s)/s for y < s, and 1/y beyond,

    directed against the motion. s is the `slip`: below it the contact sticks elastically, beyond it
    slides under μ |N|. F is the gradient by u of μ |N| f(y), for a normal force that is held
    (Li et al. 2020, eqs. 13-15, with the anchor in the place of the last positions).

    The elastic part of the slip, at most s long, is what a step leaves to the next: the anchor
    follows a sliding vertex at the distance s (the return mapping of plasticity; Wriggers 2006,
    section 5.2.3). A held load therefore does not creep.

    Attributes:
        friction: Coefficient μ.
        slip: s in m.

    Raises:
        ParameterError: A number is not positive.
    """

    friction: float
    slip: float

    def __post_init__(self) -> None:
        require_positive(friction=self.friction, slip=self.slip)

    def energy(self, normal: Floats, motion: Floats) -> Floats:
        """Return μ |N| f(|P u|) in J, (n,), with f(0) = 0.

        Args:
            normal: N in N, (n, 3).
            motion: u in m, (n, 3).
        """
        size, _, _, length = _parts(normal, motion)
        y = np.minimum(length / self.slip, 1.0)
        f = self.slip * (y**2 - y**3 / 3) + np.maximum(length - self.slip, 0.0)
        return np.asarray(self.friction * size * f)

    def force(self, normal: Floats, motion: Floats) -> Floats:
        """Return F in N, (n, 3): the gradient of `energy` by the motion."""
        size, _, tangential, length = _parts(normal, motion)
        ratio, _ = self._ratio(length)
        return np.asarray((self.friction * size * ratio)[:, None] * tangential)

    def stiffness(self, normal: Floats, motion: Floats) -> Floats:
        """Return ∂F/∂u in N/m, (n, 3, 3), symmetric and positive semidefinite."""
        size, unit, tangential, length = _parts(normal, motion)
        ratio, change = self._ratio(length)
        parts = ratio[:, None, None] * _projector(unit)
        parts += change[:, None, None] * _outer(tangential, tangential)
        return np.asarray((self.friction * size)[:, None, None] * parts)

    def force_by_normal(self, normal: Floats, motion: Floats) -> Floats:
        """Return ∂F/∂N, (n, 3, 3): more or less friction, and another tangent plane."""
        _, unit, tangential, length = _parts(normal, motion)
        ratio, change = self._ratio(length)
        across = np.einsum("ij,ij->i", unit, motion)[:, None, None]
        turned = across * _projector(unit) + _outer(unit, tangential)
        parts = ratio[:, None, None] * (_outer(tangential, unit) - turned)
        parts -= across * change[:, None, None] * _outer(tangential, tangential)
        return np.asarray(self.friction * parts)

    def elastic(self, normal: Floats, motion: Floats) -> Floats:
        """Return the elastic slip in m, (n, 3): P u, shortened to s; zero without normal force."""
        size, _, tangential, length = _parts(normal, motion)
        factor, _ = self._shortened(length)
        return np.asarray((factor * (size > 0))[:, None] * tangential)

    def elastic_by_motion(self, normal: Floats, motion: Floats) -> Floats:
        """Return the derivative of `elastic` by the motion, (n, 3, 3)."""
        size, unit, tangential, length = _parts(normal, motion)
        factor, change = self._shortened(length)
        parts = factor[:, None, None] * _projector(unit)
        parts += change[:, None, None] * _outer(tangential, tangential)
        return np.asarray((size > 0)[:, None, None] * parts)

    def elastic_by_normal(self, normal: Floats, motion: Floats) -> Floats:
        """Return the derivative of `elastic` by N in m/N, (n, 3, 3)."""
        size, unit, tangential, length = _parts(normal, motion)
        factor, change = self._shortened(length)
        across = np.einsum("ij,ij->i", unit, motion)[:, None, None]
        parts = factor[:, None, None] * (across * _projector(unit) + _outer(unit, tangential))
        parts += across * change[:, None, None] * _outer(tangential, tangential)
        inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
        return np.asarray(-inverse[:, None, None] * parts)

    def _ratio(self, length: Floats) -> tuple[Floats, Floats]:
        """Return φ in 1/m and φ'/y in 1/m³ at lengths y; the latter is bounded in products."""
        s = self.slip
        safe = np.maximum(length, 1e-9 * s)  # P u Puᵀ is smaller than y
        slides = length >= s
        ratio = np.where(slides, 1 / safe, (2 - length / s) / s)
        change = np.where(slides, -1 / safe**3, -1 / (s**2 * safe))
        return ratio, change

    def _shortened(self, length: Floats) -> tuple[Floats, Floats]:
        """Return the factor that shortens P u to s, and its derivative over y."""
        safe = np.maximum(length, self.slip)
        return self.slip / safe, np.where(length > self.slip, -self.slip / safe**3, 0.0)


def _parts(normal: Floats, motion: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return |N|, n, P u and |P u|; without a normal force n is zero."""
    size = np.linalg.norm(normal, axis=1)
    unit = normal / np.where(size > 0, size, 1.0)[:, None]
    tangential = motion - np.einsum("ij,ij->i", unit, motion)[:, None] * unit
    return size, unit, tangential, np.linalg.norm(tangential, axis=1)


def _projector(unit: Floats) -> Floats:
    return np.asarray(np.eye(3) - _outer(unit, unit))


def _outer(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, :, None] * b[:, None, :])
