"""The model: what it fixes, folds, and the modulus it measures by."""

import numpy as np
import pytest
from helpers.models import bent_tube
from helpers.scenes import square
from helpers.standing import model_on_base
from mpi4py import MPI

from toros_fem.materials.sheet import Bladder, Composite, Material
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.model import make_model
from toros_fem.meshes import Skin, sew


def test_fixed_components_have_reactions_and_the_others_forces(short_tube: Skin) -> None:
    model = model_on_base(short_tube)
    model.set_density(np.full(len(short_tube.owned_cells), 0.3))
    model.set_load(Load(np.array([1e3])))
    state = bent_tube(model)
    fixed = model.skin.gather_vertices(model.positions((~model.free).astype(float)))
    assert np.array_equal(fixed.astype(bool), model.supports.fixed)
    force, reaction = model.residual(state), model.reaction(state)
    assert not force[~model.free].any()
    assert not reaction[model.free].any()
    assert np.abs(force).max() > 0
    assert model.energy(3 * model.assembled) == np.inf
    assert np.isfinite(model.energy(model.assembled))


def test_mean_modulus(short_tube: Skin) -> None:
    """Of plain, reinforced and half reinforced skin, and of rubber, μ = E/3 and λ = 2 μ."""
    rubber = Bladder(0.3e6, 1e-3)
    plain, lined = (
        model_on_base(
            short_tube,
            Composite(reinforcement=Material(26e6, 0.3, 0.5e-3), bladder=bladder, bending=None),
        )
        for bladder in (None, rubber)
    )
    values = []
    for density in (0.0, 1.0, 0.5):
        plain.set_density(np.full(len(short_tube.owned_cells), density))
        values.append(plain.mean_modulus())
    fabric = plain.composite.fabric
    assert values[0] == pytest.approx(fabric.thickness * (2 * fabric.mu + fabric.lam))
    assert values[1] == pytest.approx(260 * values[0])
    assert values[2] == pytest.approx((values[0] + values[1]) / 2)
    lined.set_density(np.zeros(len(short_tube.owned_cells)))
    assert lined.mean_modulus() - values[0] == pytest.approx(4 / 3 * 300)
    assert lined.soft_modulus() == pytest.approx(lined.mean_modulus()), "alike everywhere"


@pytest.mark.parametrize("bending", [True, False])
def test_folds_are_counted_from_both_sides(alone: MPI.Comm, bending: bool) -> None:
    pattern = square(n=4)
    fixed = Supports(np.ones(pattern.points.shape, dtype=bool))
    composite = Composite() if bending else Composite(bending=None)
    model = make_model(sew(alone, pattern), composite, fixed)
    state = model.assembled
    nodes = model.positions(state)
    over = nodes[:, 0] > 0.01
    nodes[over, 2] = nodes[over, 0] - 0.01  # a right angle along four edges
    nodes[over, 0] = 0.01
    assert model.count_folds(state, np.radians(80)) == (8 if bending else 0)
    assert model.count_folds(state, np.radians(100)) == 0
