"""Pads that slide one way, as scales and bristles do, and their law of friction.

A coefficient that depends on the direction of sliding follows from a convex function of it, its
gauge: friction is normal to the gauge's level (Goyal, Ruina & Papadopoulos 1991, limit surfaces).
So a step of a path has a minimum, as with equal coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_floats, require_positive


@dataclass(frozen=True, eq=False)
class Pads:
    """Pads on a skin that slide easily in one direction along the ground.

    Attributes:
        vertices: Whether each assembled vertex carries a pad, (n,).
        direction: Direction in which they slide easily; its length does not matter. What of it is
            normal to the ground is left out.
        forward: Coefficient of friction in this direction.
        backward: Coefficient against this direction and across it, at least `forward`.

    Raises:
        ParameterError: A value is not admissible, or no vertex carries a pad.
    """

    vertices: Bools
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    forward: float = 0.2
    backward: float = 0.8

    def __post_init__(self) -> None:
        require_positive(forward=self.forward, backward=self.backward)
        if self.forward > self.backward:
            raise ParameterError(
                f"forward = {self.forward:g} must be at most backward = {self.backward:g}: turn "
                "the direction round."
            )
        vertices = np.array(self.vertices)
        if vertices.dtype != bool or vertices.ndim != 1 or not vertices.any():
            raise ParameterError(
                "vertices must be True or False for each assembled vertex, (n,), and True for one "
                "at least."
            )
        vertices.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        what = "a finite vector of three, other than 0"
        given = checked_floats("direction", self.direction, what, (3,))
        length = float(np.linalg.norm(given))
        if length == 0:
            raise ParameterError(f"direction = {self.direction} must be {what}.")
        object.__setattr__(self, "direction", tuple(float(v) for v in given / length))

    def law(self, slip: float) -> OneWay:
        """Return the law of friction of the pads, regularised over a slip in m."""
        return OneWay(self.backward, self.forward / self.backward, self.direction, slip)


@dataclass(frozen=True)
class OneWay:
    """Friction at vertices whose coefficient depends on the direction, as `Coulomb` otherwise.

    With P = I − n nᵀ, s = d·u the motion along the easy direction d in the ground, and a = `ratio`
    for s > 0, else 1, the gauge of a motion u is g = √(|P u|² − (1 − a²) s²). Friction is

        F = μ |N| φ(g) m,   m = P u − (1 − a²) s d,   φ as of `Coulomb`,

    the gradient by u of a convex function of g. The stiffness jumps where s changes its sign. n is
    the normal of the ground, which is fixed, so that N changes its size alone.

    Attributes:
        friction: μ, against the easy direction and across it.
        ratio: Coefficient in the easy direction over μ, at most 1.
        direction: Unit vector that points in the easy direction.
        slip: In m, of the gauge, at which friction is fully mobilised: as far backward, and
            1 / `ratio` times as far in the easy direction.
    """

    friction: float
    ratio: float
    direction: tuple[float, float, float]
    slip: float

    def energy(self, normal: Floats, motion: Floats) -> Floats:
        """Return μ |N| f(g) in J, (n,), with f(0) = 0.

        Args:
            normal: N in N, (n, 3).
            motion: u in m, (n, 3).
        """
        parts = _Parts(self, normal, motion)
        y = np.minimum(parts.gauge / self.slip, 1.0)
        f = self.slip * (y**2 - y**3 / 3) + np.maximum(parts.gauge - self.slip, 0.0)
        return np.asarray(self.friction * parts.size * f)

    def force(self, normal: Floats, motion: Floats) -> Floats:
        """Return F in N, (n, 3): the gradient of `energy` by the motion."""
        parts = _Parts(self, normal, motion)
        return np.asarray((self.friction * parts.size * parts.phi)[:, None] * parts.along)

    def stiffness(self, normal: Floats, motion: Floats) -> Floats:
        """Return ∂F/∂u in N/m, (n, 3, 3), symmetric and positive semidefinite."""
        parts = _Parts(self, normal, motion)
        turned = parts.phi[:, None, None] * parts.metric
        turned += parts.phi_change[:, None, None] * _outer(parts.along, parts.along)
        return np.asarray((self.friction * parts.size)[:, None, None] * turned)

    def force_by_normal(self, normal: Floats, motion: Floats) -> Floats:
        """Return ∂F/∂N, (n, 3, 3), for a normal force that changes its size."""
        parts = _Parts(self, normal, motion)
        return np.asarray(self.friction * _outer(parts.phi[:, None] * parts.along, parts.unit))

    def elastic(self, normal: Floats, motion: Floats) -> Floats:
        """Return the elastic slip in m, (n, 3): P u, its gauge shortened to `slip`.

        It has the friction of the whole motion. Without a normal force it is zero.
        """
        parts = _Parts(self, normal, motion)
        kept = self.slip / np.maximum(parts.gauge, self.slip) * (parts.size > 0)
        return np.asarray(kept[:, None] * parts.tangential)

    def elastic_by_motion(self, normal: Floats, motion: Floats) -> Floats:
        """Return the derivative of `elastic` by the motion, (n, 3, 3)."""
        parts = _Parts(self, normal, motion)
        longer = np.maximum(parts.gauge, self.slip)
        change = np.where(parts.gauge > self.slip, -self.slip / longer**3, 0.0)
        turned = (self.slip / longer)[:, None, None] * parts.plane
        turned += change[:, None, None] * _outer(parts.tangential, parts.along)
        return np.asarray((parts.size > 0)[:, None, None] * turned)

    def elastic_by_normal(self, normal: Floats, motion: Floats) -> Floats:
        """Return the derivative of `elastic` by N in m/N, (n, 3, 3): zero."""
        return np.zeros((*normal.shape, 3))


class _Parts:
    """What all quantities of the law are made of.

    Attributes:
        size, unit: |N| and n; n is zero without a normal force.
        plane: P, (n, 3, 3).
        tangential: P u, (n, 3).
        metric: Derivative of m by u, (n, 3, 3).
        along: m, (n, 3).
        gauge: g, (n,).
        phi, phi_change: φ in 1/m and φ'/g in 1/m³.
    """

    def __init__(self, law: OneWay, normal: Floats, motion: Floats) -> None:
        self.size = np.linalg.norm(normal, axis=1)
        self.unit = normal / np.where(self.size > 0, self.size, 1.0)[:, None]
        self.plane = np.eye(3) - _outer(self.unit, self.unit)
        self.tangential = np.einsum("nij,nj->ni", self.plane, motion)
        easy = np.einsum("nij,j->ni", self.plane, np.array(law.direction))
        easy /= np.maximum(np.linalg.norm(easy, axis=1), 1e-12)[:, None]
        ahead = np.einsum("ni,ni->n", easy, motion) > 0
        less = (1 - law.ratio**2) * ahead
        self.metric = self.plane - less[:, None, None] * _outer(easy, easy)
        self.along = np.einsum("nij,nj->ni", self.metric, motion)
        self.gauge = np.sqrt(np.einsum("ni,ni->n", self.along, self.tangential))
        slip, slides = law.slip, self.gauge >= law.slip
        safe = np.maximum(self.gauge, 1e-9 * slip)  # m mᵀ is smaller than g
        self.phi = np.where(slides, 1 / safe, (2 - self.gauge / slip) / slip)
        self.phi_change = np.where(slides, -1 / safe**3, -1 / (slip**2 * safe))


def _outer(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, :, None] * b[:, None, :])
