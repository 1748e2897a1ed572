"""Free bodies: a plate presses a ball into a stretched sheet."""

import json

import numpy as np
import pytest
from helpers.touching import Lifted, sheet_with_ball
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.mechanics.contact.contact import SkinContact
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver

pytestmark = pytest.mark.slow


def plain(solver: EquilibriumSolver) -> np.ndarray:
    return np.zeros(len(solver.skin.owned_cells))


@pytest.fixture(scope="module")
def lifted(comm: MPI.Comm) -> Lifted:
    return sheet_with_ball(comm)


@pytest.fixture(scope="module")
def pressed(lifted: Lifted) -> Equilibrium:
    solver, load = lifted
    return solver.solve(plain(solver), load)


def test_the_ball_hands_the_force_on(lifted: Lifted, pressed: Equilibrium) -> None:
    """To the solver's tolerance: what little stiffness a free ball has takes no force."""
    solver, _ = lifted
    contact = solver.model.contact
    assert isinstance(contact, SkinContact)
    assert pressed.smallest_distance > 0
    forces = contact.forces(pressed.state)
    skin, ball = len(solver.skin.pattern.points), len(contact.contact.bodies[0].points)
    on_ball, on_plate = forces[skin : skin + ball].sum(axis=0), forces[skin + ball :].sum(axis=0)
    assert abs(on_plate[2]) > 0.1
    assert np.abs(on_ball).max() < 1e-8 * abs(on_plate[2])
    assert np.abs(solver.reactions(pressed).sum(axis=0) + on_plate).max() < 1e-8 * abs(on_plate[2])
    pose, _ = pressed.poses
    # It has rolled into the middle, as far as large triangles have one.
    assert pose[:2] == pytest.approx([-0.003, -0.001], abs=2e-3)
    assert np.linalg.norm(pose[3:]) > 0.05
    assert not contact.crossed(pressed.state)


def test_saved_and_restored(lifted: Lifted, pressed: Equilibrium) -> None:
    solver, load = lifted
    density = plain(solver)
    found = solver.solve(density, load, start=pressed)
    unknowns, numbers = solver.save(found)
    assert unknowns.shape == (solver.model.space.dofmap.index_map.size_global,)
    solver.forget()
    again = solver.restore(density, unknowns, json.loads(json.dumps(numbers)), load)
    assert np.array_equal(again.state, found.state)
    assert again.poses == found.poses
    assert solver.solve(density, load, start=again).steps == 0


def test_a_ball_that_has_turned_far_starts_from_less(lifted: Lifted, pressed: Equilibrium) -> None:
    """A whole turn more is the same place; the solver takes it out."""
    solver, load = lifted
    model, comm = solver.model, solver.skin.comm
    turned = pressed.state.copy()
    assert isinstance(model.contact, SkinContact)
    motions = comm.bcast(model.contact.motions(turned), root=0)
    vector = motions[0, 3:]
    radius = model.contact.contact.bodies[0].radius
    more = vector * (1 + 2 * np.pi * radius / np.linalg.norm(vector))
    if comm.rank == 0:
        turned[-3:] = more
    found = solver.solve(plain(solver), load, start=turned)
    assert np.linalg.norm(found.poses[0][3:]) < np.pi
    assert np.array(found.poses) == pytest.approx(np.array(pressed.poses), abs=1e-6)


def test_no_adjoint_through_friction_on_a_free_body(comm: MPI.Comm) -> None:
    solver, load = sheet_with_ball(comm, friction=0.2)
    found = solver.solve(plain(solver), load)
    with pytest.raises(ParameterError, match="no adjoint through friction on free bodies"):
        solver.solve_tangent(found.state, found, adjoint=True)
