"""Motion of a skin along a few directions, as residuals whose squares are a part of T.

A pressure changes the amplitude of a whole deformation, a bend for instance, and so does every
density. In MMA's separable approximation each of them alone takes the amplitude to its target, and
all together go far beyond. As a residual of its own the amplitude is approximated first and squared
afterwards: the sum of all changes counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.mpi import dot, largest, sum_over_ranks
from toros_fem.base.validation import Floats
from toros_fem.measures.shape import Objective
from toros_fem.meshes.skin import Skin

# Length of the differences that give the objective's curvature, over the skin's size.
DIFFERENCE = 1e-4
# Least eigenvalue of H after its diagonal is scaled to 1.
LEAST = 1e-6


@dataclass(frozen=True, eq=False)
class Motion:
    """Residuals r, (j,), linear in the positions around a shape.

    With directions Y, the objective's slope g = Yᵀ∂T/∂x and its curvature H = Yᵀ(∂²T/∂x²)Y = L Lᵀ,
    r = L⁻¹ (g + Yᵀ ∂²T/∂x² (x − x₀)) / √2. Along Y the squares of r are then the quadratic part of
    T, up to a constant. Where T is not convex along Y, or where two directions are nearly alike,
    H is replaced by a matrix that is safely positive definite.

    Attributes:
        skin: The skin.
        here: Positions x₀ of the owned nodes, (n, 3), in m.
        offsets: r at x₀, (j,).
        directions: ∂r/∂x at the owned nodes in 1/m, (j, n, 3).
    """

    skin: Skin
    here: Floats
    offsets: Floats
    directions: Floats

    def along(self, positions: Floats) -> Floats:
        """Return r, (j,), at positions of the owned nodes, (n, 3) (collective)."""
        local: Floats = np.einsum("jnk,nk->j", self.directions, positions - self.here)
        return np.asarray(self.offsets + sum_over_ranks(self.skin.comm, local))


def motion_along(
    skin: Skin, objective: Objective, positions: Floats, moves: Sequence[Floats]
) -> Motion:
    """Return the residuals along directions Y at the owned nodes, each (n, 3) (collective).

    Directions may have any unit; one without any motion has a residual of 0.
    """
    comm = skin.comm
    here: Floats = np.array(positions)
    bent: Floats = np.zeros((len(moves), *here.shape))
    for k, move in enumerate(moves):
        longest = largest(comm, float(np.abs(move).max(initial=0.0)))
        if longest > 0:
            step = DIFFERENCE * skin.pattern.size / longest
            ahead, behind = (objective.backward(here + sign * step * move) for sign in (1, -1))
            bent[k] = (ahead - behind) / (2 * step)
    slope = objective.backward(here)
    slopes = np.array([dot(comm, move.ravel(), slope.ravel()) for move in moves])
    curvature = np.array([[dot(comm, a.ravel(), b.ravel()) for b in bent] for a in moves])
    inverse = _inverse_root(curvature.reshape(len(moves), len(moves))) / np.sqrt(2)
    return Motion(skin, here, inverse @ slopes, np.einsum("ij,jnk->ink", inverse, bent))


def _inverse_root(curvature: Floats) -> Floats:
    """Return L⁻¹ with L Lᵀ a positive definite matrix near H; rows of zeros where H has them."""
    size = np.sqrt(np.abs(np.diag(curvature)))
    inverse_size = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    scaled = inverse_size[:, None] * (curvature + curvature.T) / 2 * inverse_size
    value, vector = np.linalg.eigh(scaled)
    value = np.maximum(np.abs(value), LEAST)
    root = np.linalg.cholesky((vector * value) @ vector.T)
    return np.asarray(np.linalg.inv(root) * inverse_size)
