"""Barriers of a skin: free steps, equilibria, and gradients of these."""

import numpy as np
import pytest
from helpers.scenes import square
from helpers.standing import solver_on_base
from helpers.touching import tube_on_floor_and_ball
from kit.slopes import slope
from mpi4py import MPI

from toros_fem.base.mpi import dot, smallest
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.contact import Contact, SkinContact
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Skin, sew

pytestmark = pytest.mark.slow


def soft(skin: Skin) -> np.ndarray:
    """A little print, unevenly."""
    return 0.02 + 0.01 * np.cos(3.0 * skin.owned_cells)


@pytest.fixture(scope="module")
def solver(tube: Skin) -> EquilibriumSolver:
    return tube_on_floor_and_ball(tube)


@pytest.fixture(scope="module")
def touching(solver: EquilibriumSolver) -> Equilibrium:
    return solver.solve(soft(solver.skin), 5e3)


def direction(solver: EquilibriumSolver, size: float) -> np.ndarray:
    model, skin = solver.model, solver.skin
    drawn = np.random.default_rng(5).standard_normal(skin.pattern.points.shape)
    out = np.zeros(model.size_local)
    model.positions(out)[:] = size * drawn[skin.owned_vertices]
    return out * model.free


def test_the_skin_rests_on_floor_and_ball(solver: EquilibriumSolver, touching: Equilibrium) -> None:
    contact = solver.model.contact
    assert isinstance(contact, SkinContact)
    assert 0 < touching.smallest_distance < contact.sizes.distance
    assert not contact.crossed(touching.state)
    forces = contact.forces(touching.state)
    skin, ball = np.split(forces, [len(solver.skin.pattern.points)])
    assert np.linalg.norm(ball.sum(axis=0)) > 0.01
    # Gradients: minus the forces. The floor pushes up, the ball away from itself.
    floor = -(skin.sum(axis=0) + ball.sum(axis=0))
    assert floor[0] > 0.01
    assert np.abs(floor[1:]).max() < 1e-12
    reactions = solver.reactions(touching).sum(axis=0)
    balance = reactions - skin.sum(axis=0)
    assert np.abs(balance).max() < 1e-8


def test_steps_stop_before_they_meet(solver: EquilibriumSolver, touching: Equilibrium) -> None:
    model = solver.model
    along = np.zeros_like(touching.state)
    model.positions(along)[:, 0] = -0.01
    fraction = model.largest_step(touching.state, along, 0.9)
    assert 0 < fraction < 0.05
    assert np.isfinite(model.energy(touching.state + fraction * along))
    gap = model.contact.gap(touching.state + fraction * along)
    assert smallest(solver.skin.comm, gap) > 0


def test_a_ball_is_pushed_into_the_tube_and_out_again(comm: MPI.Comm, tube: Skin) -> None:
    """By 6 mm at once, half of the tube's radius and fifty times the gap that it begins with."""
    contact = Contact(bodies=[rigid_sphere("ball", 0.006, (0.0, 0.0175, 0.035))])
    solver = solver_on_base(tube, contact=contact)
    density = soft(tube)
    free = solver.solve(density, 2e3)
    way = np.array([[0.0, -0.006, 0.0, 0.5, 0.0, 0.0]])
    pushed = solver.solve(density, Load(2e3, poses=way), start=free)
    assert pushed.poses == ((0.0, -0.006, 0.0, 0.5, 0.0, 0.0),)
    assert pushed.smallest_distance > 0
    assert pushed.volume < 0.995 * free.volume
    term = solver.model.contact
    assert isinstance(term, SkinContact)
    assert not term.crossed(pushed.state)
    forces = term.forces(pushed.state)
    assert -forces[len(tube.pattern.points) :].sum(axis=0)[1] > 0.05, "the tube pushes it out"
    back = solver.solve(density, 2e3, start=pushed)
    assert back.energy == pytest.approx(free.energy, rel=1e-9)


def test_a_ball_does_not_pass_through_a_sheet(comm: MPI.Comm) -> None:
    """Its new place is free, but the sheet is in the way: it is pushed out far."""
    pattern = square(n=6)
    skin = sew(comm, pattern)
    edge = np.isin(np.arange(49), np.unique(pattern.free_edges))
    ball = rigid_sphere("ball", 0.003, (0.01, 0.01, 0.004))
    frame, contact = Supports(np.repeat(edge[:, None], 3, axis=1)), Contact(bodies=[ball])
    solver = EquilibriumSolver(skin, Composite(), frame, contact=contact)
    density = np.zeros(len(skin.owned_cells))
    rest = solver.solve(density, 0.0)
    way = np.array([[0.0, 0.0, -0.008, 0.0, 0.0, 0.0]])
    below = solver.solve(density, Load(poses=way), start=rest)
    depth = skin.gather_vertices(below.positions)[:, 2].min()
    assert depth < -0.007
    assert "bodies moved by up to 0.008 m" in below.reason
    assert not solver.model.contact.crossed(below.state)


def test_neighbours_of_a_thick_sheet_do_not_cross(comm: MPI.Comm) -> None:
    """Edges are shorter than the sheet is thick: a sharp fold is within it, but not through it."""
    flat = square(n=10).points
    opening, turned = 0.05, np.maximum(flat[:, 0] - 0.01, 0.0)
    shape = np.column_stack(
        [
            np.minimum(flat[:, 0], 0.01) - turned * np.cos(opening),
            flat[:, 1],
            turned * np.sin(opening),
        ]
    )
    skin = sew(comm, square(n=10))
    fixed = np.repeat((flat[:, 0] < 3e-3)[:, None], 3, axis=1)
    thick = Contact(thickness=0.03, distance=1e-3, stiffness=1e4)
    solver = EquilibriumSolver(skin, Composite(), Supports(fixed), contact=thick)
    model, contact = solver.model, solver.model.contact
    assert isinstance(contact, SkinContact)
    state = model.state_of(shape[skin.owned_vertices])
    energy = contact.energy(state)
    assert 0 < energy < np.inf
    assert contact.count_pairs(state) > 0
    along = direction(solver, 1e-6)
    model.set_density(np.zeros(len(skin.owned_cells)))
    rise = slope(lambda h: model.energy(state + 0.02 * h * along)) / 0.02
    assert dot(comm, model.residual(state), along) == pytest.approx(rise, rel=1e-7)
    closing = np.zeros_like(state)
    model.positions(closing)[:, 2] = -2 * model.positions(state)[:, 2]
    assert model.largest_step(state, closing, 0.9) < 0.5
