"""Periodic tiles: mean deformation gradient, its force, and its rows of the tangent."""

import numpy as np
import pytest
from kit.slopes import slope
from mpi4py import MPI

from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.assembly.model import SkinModel, make_model
from toros_fem.mechanics.assembly.tangent import UpperTangent
from toros_fem.mechanics.skin.periodicity import ALL_PRESCRIBED, Periodic
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Tile, sew, tile

SIDE = 0.01


SKEWED = np.array([[1.08, 0.06], [-0.03, 0.95], [0.0, 0.0]])


@pytest.fixture(scope="module")
def square_tile(alone: MPI.Comm) -> Tile:
    return tile(alone, (SIDE, SIDE), SIDE / 4)


def model_of(found: Tile, comm: MPI.Comm, composite: Composite) -> SkinModel:
    """Every component of F̄ and of all vertices but one is free in the plane."""
    skin = sew(comm, found.pattern)
    fixed = np.zeros(found.pattern.points.shape, dtype=bool)
    fixed[0] = True
    turns_fixed = ((False, False), (True, False), (True, True))
    model = make_model(skin, composite, Supports(fixed), periodic=Periodic(found, turns_fixed))
    density = np.random.default_rng(5).uniform(0, 1, len(found.wraps))
    model.set_density(density[skin.owned_cells])
    model.images.turn(0.4)
    return model


@pytest.fixture(scope="module", params=[None, "midedge"])
def periodic(request: pytest.FixtureRequest, square_tile: Tile, alone: MPI.Comm) -> SkinModel:
    bending = None if request.param is None else Bending(request.param)
    return model_of(square_tile, alone, Composite(bending=bending))


def stretched(model: SkinModel) -> np.ndarray:
    """A state of a mean deformation, with waves in all components."""
    state = model.assembled
    c, s = np.cos(0.4), np.sin(0.4)
    flat = model.positions(state)[:, :2] @ np.array([[c, -s], [s, c]])
    x, y = (2 * np.pi * model.positions(state)[:, :2] / SIDE).T
    waves = np.column_stack([np.sin(x), np.cos(y), np.sin(x + y)])
    model.positions(state)[:] = flat @ SKEWED.T + 0.02 * SIDE * waves
    model.images.set_mean_gradient(state, SKEWED)
    return state


def test_mean_gradient_is_read_back(periodic: SkinModel) -> None:
    state = periodic.assembled
    assert periodic.images.mean_gradient(state) == pytest.approx(np.eye(3)[:, :2])
    periodic.images.set_mean_gradient(state, SKEWED)
    assert periodic.images.mean_gradient(state) == pytest.approx(SKEWED, rel=1e-15)


def test_the_force_changes_with_the_mean_gradient(periodic: SkinModel) -> None:
    """With F̄ alone, as the tile's response needs it."""
    model, comm, state = periodic, periodic.skin.comm, stretched(periodic)
    change = np.random.default_rng(7).standard_normal((3, 2))
    tangent = UpperTangent(model)
    entries = np.zeros(tangent.triangles.count)
    tangent.triangles.compute(state, entries)
    by_gradient = tangent.periodic.force(entries, change) * model.free

    def force(h: float) -> np.ndarray:
        moved = state.copy()
        model.images.set_mean_gradient(moved, SKEWED + 1e-5 * h * change)
        return model.residual(moved)

    expected = slope(force) / 1e-5
    assert norm(comm, by_gradient - expected) < 1e-7 * norm(comm, expected)


def test_images_lie_one_lattice_step_away(square_tile: Tile, alone: MPI.Comm) -> None:
    """In a homogeneous state each triangle sees a copy of itself, at the border as inside."""
    model = model_of(square_tile, alone, Composite(bending=None))
    state = model.assembled
    c, s = np.cos(0.4), np.sin(0.4)
    turned = np.array([[c, -s], [s, c]])
    model.positions(state)[:] = model.positions(state)[:, :2] @ turned @ SKEWED.T
    model.images.set_mean_gradient(state, SKEWED)
    assert model.images.images.any()
    one, two = np.linalg.svd(SKEWED, compute_uv=False)
    c1, c2 = model.composite.c1, model.composite.c2
    single = max(abs(one - 1), abs(two - 1)) / (c1 - 1)
    expected = max(single, abs(one + two - 2) / (c2 - 1))
    assert model.bounds.worst(model.corners(state)) == pytest.approx(expected, rel=1e-9)


def test_prescribed_components_are_fixed(square_tile: Tile, alone: MPI.Comm) -> None:
    skin = sew(alone, square_tile.pattern)
    fixed = np.zeros(square_tile.pattern.points.shape, dtype=bool)
    fixed[0] = True
    rest = Periodic(square_tile, ALL_PRESCRIBED)
    model = make_model(skin, Composite(bending=None), Supports(fixed), periodic=rest)
    assert model.fixed[model.images.dofs].all()
    assert rest.length == pytest.approx(SIDE)
