"""A rubber layer under the fabric: exact stresses, its tangent, and what it leaves alone."""

import numpy as np
import pytest
from helpers.models import SIZE
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.materials.sheet import Bladder, Composite, Material
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import sew

RUBBER = Bladder(young=0.29e6, thickness=0.8e-3)  # Dragon Skin 20
STIFFENS = Bladder(young=0.29e6, thickness=0.8e-3, second=-3e3, third=2e4)


MU = 0.29e6 / 3


@pytest.mark.parametrize("rubber", [RUBBER, STIFFENS])
def test_uniaxial_tension_of_rubber_alone(alone: MPI.Comm, rubber: Bladder) -> None:
    """With a fabric of no account: lateral stretch λ^(−1/2), nominal stress μ (λ − λ⁻²).

    By Yeoh's law it is 2 (λ − λ⁻²) (μ/2 + 2 C₂₀ (I₁ − 3) + 3 C₃₀ (I₁ − 3)²).
    """
    pull = 1.4
    pattern = square(size=SIZE)
    points = pattern.points
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[:, 2], fixed[0, 1] = True, True
    pulled = points[:, 0] > SIZE * (1 - 1e-9)
    fixed[(points[:, 0] < 1e-9) | pulled, 0] = True
    supports = Supports(fixed, displacement=np.where(pulled[:, None], [(pull - 1) * SIZE, 0, 0], 0))
    skin = sew(alone, pattern)
    thin = Composite(fabric=Material(0.01, 0.0, 1e-3), bending=None, bladder=rubber)
    solver = EquilibriumSolver(skin, thin, supports)
    found = solver.solve(np.zeros(len(skin.owned_cells)), 0.0)
    expected = points * [pull, pull**-0.5, 0]
    assert skin.gather_vertices(found.positions) / SIZE == pytest.approx(expected / SIZE, abs=1e-7)
    force = solver.reactions(found)[pulled, 0].sum() / (SIZE * RUBBER.thickness)
    invariant = pull**2 + 2 / pull - 3
    more = 4 * (rubber.second or 0.0) * invariant + 6 * (rubber.third or 0.0) * invariant**2
    assert force == pytest.approx((MU + more) * (pull - pull**-2), rel=1e-6)
