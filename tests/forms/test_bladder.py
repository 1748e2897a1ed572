"""A rubber layer under the fabric: exact stresses, its tangent, and what it leaves alone."""

import numpy as np
import pytest
from helpers.models import SIZE, affine, sheet_model
from helpers.scenes import TABLE_A, square
from mpi4py import MPI

from toros_fem.materials.sheet import Bladder, Composite, Material
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import sew

RUBBER = Bladder(young=0.29e6, thickness=0.8e-3)  # Dragon Skin 20


MU = 0.29e6 / 3


@pytest.mark.parametrize("stretches", [(1.3, 1.3), (1.4, 1.4**-0.5), (0.8, 1.1), (1.0, 1.0)])
def test_energy_and_stress_by_hand(alone: MPI.Comm, stretches: tuple[float, float]) -> None:
    """What the bladder adds to an affine sheet, exact: μ (λ₁ − 1/(λ₁³ λ₂²)) along."""
    one, two = stretches
    values = []
    for bladder in (RUBBER, None):
        model = sheet_model(alone, Composite(fabric=TABLE_A, bending=None, bladder=bladder))
        model.set_density(np.zeros(len(model.skin.owned_cells)))
        state = affine(model, np.array([[one, 0], [0, two], [0, 0]]))
        force = model.skin.gather_vertices(model.residual(state).reshape(-1, 3))
        border = model.skin.pattern.points[:, 0] > SIZE * (1 - 1e-9)
        values.append((model.energy(state), force[border].sum(axis=0)))
    psi = MU / 2 * (one**2 + two**2 + (one * two) ** -2 - 3)
    added = values[0][0] - values[1][0]
    assert added == pytest.approx(psi * RUBBER.thickness * SIZE**2, rel=1e-10, abs=1e-16)
    pull = (values[0][1] - values[1][1]) / (RUBBER.thickness * SIZE)
    assert pull[0] == pytest.approx(MU * (one - 1 / (one**3 * two**2)), rel=1e-10, abs=1e-5)
    assert pull[1:] == pytest.approx([0, 0], abs=1e-5)


def test_uniaxial_tension_of_rubber_alone(alone: MPI.Comm) -> None:
    """With a fabric of no account: lateral stretch λ^(−1/2), nominal stress μ (λ − λ⁻²)."""
    pull = 1.4
    pattern = square(size=SIZE)
    points = pattern.points
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[:, 2], fixed[0, 1] = True, True
    pulled = points[:, 0] > SIZE * (1 - 1e-9)
    fixed[(points[:, 0] < 1e-9) | pulled, 0] = True
    supports = Supports(fixed, displacement=np.where(pulled[:, None], [(pull - 1) * SIZE, 0, 0], 0))
    skin = sew(alone, pattern)
    thin = Composite(fabric=Material(0.01, 0.0, 1e-3), bending=None, bladder=RUBBER)
    solver = EquilibriumSolver(skin, thin, supports)
    found = solver.solve(np.zeros(len(skin.owned_cells)), 0.0)
    expected = points * [pull, pull**-0.5, 0]
    assert skin.gather_vertices(found.positions) / SIZE == pytest.approx(expected / SIZE, abs=1e-7)
    force = solver.reactions(found)[pulled, 0].sum() / (SIZE * RUBBER.thickness)
    assert force == pytest.approx(MU * (pull - pull**-2), rel=1e-6)
