"""Pads that slide one way, as scales and bristles do, and their law of friction.

A coefficient that depends on the direction of sliding follows from a convex function of it, its
gauge: friction is normal to the gauge's level (Goyal, Ruina & Papadopoulos 1991, limit surfaces).
So friction keeps its potential, and a step of a path has a minimum, as with equal coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem._types import Bools, Floats
from toros_fem._validate import checked_floats, require_positive
from toros_fem.errors import ParameterError


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

    def law(self, slip: float) -> SlidingLaw:
        """Return the law of friction of the pads, regularised over a sliding distance in m."""
        return SlidingLaw(self.backward, self.forward / self.backward, slip)


@dataclass(frozen=True)
class SlidingLaw:
    """Friction over a normal force, as a convex potential of the sliding (s, w) in m.

    s is measured along the easy direction and w across it. The gauge is
    g = √(a² s² + w²) with a = `ratio` for s > 0, else 1. The potential is μ f₀(g), f₀ as of Li et
    al. 2020, eq. (15): g beyond `slip`, quadratic and cubic below it. Its first derivative is
    continuous, the second jumps where s changes its sign.

    Attributes:
        coefficient: μ, against the easy direction and across it.
        ratio: Coefficient in the easy direction over μ; 1 for none.
        slip: Sliding in m at which friction is fully mobilised; 1 / `ratio` times as much in the
            easy direction.
    """

    coefficient: float
    ratio: float
    slip: float

    def gauge(self, sliding: Floats) -> Floats:
        """Return g in m of each sliding, (n, 2)."""
        return np.asarray(np.sqrt((self._metric(sliding) * sliding**2).sum(axis=1)))

    def potential(self, sliding: Floats) -> Floats:
        """Return the potential over the normal force in m of each sliding, (n, 2)."""
        g, eps = self.gauge(sliding), self.slip
        below = g**2 / eps - g**3 / (3 * eps**2) + eps / 3
        return np.asarray(self.coefficient * np.where(g < eps, below, g))

    def gradient(self, sliding: Floats) -> Floats:
        """Return the potential's gradient, (n, 2): friction, turned round, over normal force."""
        scale = self.coefficient * self._slope(self.gauge(sliding))
        return np.asarray(scale[:, None] * self._metric(sliding) * sliding)

    def hessian(self, sliding: Floats) -> Floats:
        """Return the second derivatives in 1/m, (n, 2, 2), positive semidefinite."""
        g, eps, metric = self.gauge(sliding), self.slip, self._metric(sliding)
        along = metric * sliding
        # f₀'' and f₀'/g differ by −g/ε² inside, by −1/g outside.
        bend = -1 / np.where(g < eps, eps**2 * np.maximum(g, 1e-9 * eps), np.maximum(g, eps) ** 3)
        outer = bend[:, None, None] * along[:, :, None] * along[:, None, :]
        straight = self._slope(g)[:, None, None] * metric[:, :, None] * np.eye(2)
        return np.asarray(self.coefficient * (outer + straight))

    def elastic(self, sliding: Floats) -> Floats:
        """Return the part of each sliding, (n, 2), that goes back when the force does.

        It is what a path carries from step to step: a pad that slides keeps the sliding of full
        friction, one that holds keeps all.
        """
        g = self.gauge(sliding)
        return np.asarray(sliding * (self.slip / np.maximum(g, self.slip))[:, None])

    def _metric(self, sliding: Floats) -> Floats:
        """Return the diagonal (a², 1) of the quadratic form of the gauge, (n, 2)."""
        easy = np.where(sliding[:, 0] > 0, self.ratio**2, 1.0)
        return np.stack([easy, np.ones_like(easy)], axis=1)

    def _slope(self, g: Floats) -> Floats:
        """Return f₀'(g) / g in 1/m."""
        eps = self.slip
        return np.asarray(np.where(g < eps, (2 - g / eps) / eps, 1 / np.maximum(g, eps)))
