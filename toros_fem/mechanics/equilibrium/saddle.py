"""The way off a saddle: its softest mode."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor

# Part of the diagonal that makes a saddle's tangent positive definite: the first and the largest.
FIRST_DIAGONAL, LARGEST_DIAGONAL = 1e-8, 1e6
ITERATIONS = 20
# Length of the mode over the skin's size.
LENGTH = 0.01


def softest_mode(model: SkinModel, factor: TangentFactor, residual: Floats, seed: int) -> Floats:
    """Return the mode of smallest curvature by inverse iteration, against a residual (collective).

    The curvature is measured by the diagonal: the material part would hide the buckling mode. The
    tangent must be assembled.
    """
    comm, diagonal = model.skin.comm, FIRST_DIAGONAL
    while not factor.factorise(diagonal=diagonal) and diagonal < LARGEST_DIAGONAL:
        diagonal *= 4
    # A start that is the same on any number of ranks: drawn by assembled vertex.
    generator = np.random.default_rng(seed)
    drawn = generator.standard_normal(model.skin.pattern.points.shape)
    mode = model.state_of(drawn[model.skin.owned_vertices])
    if model.contact is not None:
        model.contact.set_motions(mode, generator.standard_normal((model.free_bodies, 6)))
    for _ in range(ITERATIONS):
        mode = factor.solve(factor.scale * mode)
        mode /= norm(comm, mode)
    mode *= -1.0 if dot(comm, mode, residual) > 0 else 1.0
    return LENGTH * model.skin.pattern.size * mode
