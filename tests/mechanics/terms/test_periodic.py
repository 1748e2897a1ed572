"""Periodic tiles: mean deformation gradient, its force, and its rows of the tangent."""

import numpy as np
import pytest
from kit.slopes import slope
from kit.terms import periodic
from mpi4py import MPI

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.model import make_model
from toros_fem.mechanics.terms.periodic import ALL_PRESCRIBED, Periodic
from toros_fem.mechanics.terms.tangent import UpperTangent
from toros_fem.meshes import sew, tile

# Of the tile in kit.terms, all of whose mean gradient in the plane is free.
SKEWED = np.array([[1.08, 0.06], [-0.03, 0.95], [0.0, 0.0]])
COMPOSITES = {"membrane": Composite(bending=None), "midedge": Composite()}
BOTH = pytest.mark.parametrize("composite", COMPOSITES.values(), ids=COMPOSITES)


@BOTH
def test_mean_gradient_is_read_back(composite: Composite) -> None:
    _, model = periodic(composite)
    state = model.assembled
    assert model.images.mean_gradient(state) == pytest.approx(np.eye(3)[:, :2])
    model.images.set_mean_gradient(state, SKEWED)
    assert model.images.mean_gradient(state) == pytest.approx(SKEWED, rel=1e-15)


@BOTH
def test_the_force_changes_with_the_mean_gradient(composite: Composite) -> None:
    """With F̄ alone, as the tile's response needs it."""
    state, model = periodic(composite)
    change = np.random.default_rng(7).standard_normal((3, 2))
    tangent = UpperTangent(model)
    tangent.assemble(state, np.zeros(len(tangent.columns)))
    by_gradient = tangent.periodic.force(change) * model.free

    def force(h: float) -> np.ndarray:
        moved = state.copy()
        model.images.set_mean_gradient(moved, SKEWED + 1e-5 * h * change)
        return model.residual(moved)

    expected = slope(force) / 1e-5
    assert np.linalg.norm(by_gradient - expected) < 1e-7 * np.linalg.norm(expected)


def test_images_lie_one_lattice_step_away() -> None:
    """In a homogeneous state each triangle sees a copy of itself, at the border as inside."""
    _, model = periodic(COMPOSITES["membrane"])
    state = model.assembled
    model.positions(state)[:] = model.positions(state)[:, :2] @ SKEWED.T
    model.images.set_mean_gradient(state, SKEWED)
    assert model.images.images.any()
    one, two = np.linalg.svd(SKEWED, compute_uv=False)
    c1, c2 = model.composite.c1, model.composite.c2
    single = max(abs(one - 1), abs(two - 1)) / (c1 - 1)
    expected = max(single, abs(one + two - 2) / (c2 - 1))
    assert model.bounds.worst(model.corners(state)) == pytest.approx(expected, rel=1e-9)


def test_prescribed_components_are_fixed(alone: MPI.Comm) -> None:
    found = tile(alone, (0.01, 0.01), 2.5e-3)
    fixed = np.zeros(found.pattern.points.shape, dtype=bool)
    fixed[0] = True
    rest = Periodic(found, ALL_PRESCRIBED)
    skin = sew(alone, found.pattern)
    model = make_model(skin, COMPOSITES["membrane"], Supports(fixed), periodic=rest)
    assert model.fixed[model.images.dofs].all()
    assert rest.length == pytest.approx(0.01)
