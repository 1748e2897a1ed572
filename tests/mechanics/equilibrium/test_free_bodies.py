"""Free bodies: a ball lies in a stretched sheet, alone or on the ground as well."""

import json

import numpy as np
import pytest
from helpers.scenes import square
from helpers.touching import MASS, SIZE, sheet_with_ball
from mpi4py import MPI

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.bodies import RigidBody
from toros_fem.mechanics.contact.settings import Contact, Ground
from toros_fem.mechanics.contact.solids import rigid_box, rigid_sphere
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.skin.supports import clamp_where
from toros_fem.meshes import sew

pytestmark = pytest.mark.slow
WEIGHT = 9.81 * MASS


def plain(solver: EquilibriumSolver) -> np.ndarray:
    return np.zeros(len(solver.skin.owned_cells))


@pytest.fixture(scope="module")
def solver(comm: MPI.Comm) -> EquilibriumSolver:
    return sheet_with_ball(comm)


@pytest.fixture(scope="module")
def lying(solver: EquilibriumSolver) -> Equilibrium:
    return solver.solve(plain(solver), 0.0)


def test_the_frame_carries_the_ball(solver: EquilibriumSolver, lying: Equilibrium) -> None:
    """To the solver's tolerance: what little stiffness a free ball has takes no force."""
    assert lying.smallest_distance > 0
    assert solver.reactions(lying).sum(axis=0) == pytest.approx(
        np.array([0, 0, WEIGHT]), abs=1e-8 * WEIGHT
    )
    (pose,) = lying.poses
    # It has rolled into the middle, as far as large triangles have one.
    assert pose[:2] == pytest.approx([-0.003, -0.001], abs=1e-3)
    assert -0.03 < pose[2] < -0.01
    assert np.linalg.norm(pose[3:]) > 0.05
    contact = solver.model.contact
    assert not contact.crossed(lying.state)


def test_saved_and_restored(solver: EquilibriumSolver, lying: Equilibrium) -> None:
    density = plain(solver)
    found = solver.solve(density, 0.0, start=lying)
    unknowns, numbers = solver.save(found)
    assert unknowns.shape == (solver.model.space.dofmap.index_map.size_global,)
    solver.forget()
    again = solver.restore(density, unknowns, json.loads(json.dumps(numbers)))
    assert np.array_equal(again.state, found.state)
    assert again.poses == found.poses
    assert solver.solve(density, 0.0, start=again).steps == 0


def test_a_path_by_arc_length_has_the_weight_of_the_ball(
    solver: EquilibriumSolver, lying: Equilibrium
) -> None:
    """The load factor scales it; the frame carries it, and the ball's pose is told."""
    options = ArcLengthOptions(first=0.9, first_increment=0.05, max_points=2)
    points = list(trace(solver, plain(solver), 0.0, start=lying, by="arc-length", options=options))
    for point in points:
        found = point.result
        assert found.poses[0][:2] == pytest.approx(lying.poses[0][:2], abs=1e-3)
        solver.model.set_load(found.load)
        up = -solver.skin.gather_vertices(
            solver.model.positions(solver.model.reaction(found.state))
        )
        assert up[:, 2].sum() == pytest.approx(-point.load_factor * WEIGHT, rel=1e-6)
    assert [point.load_factor for point in points][1] > 0.9


def test_on_the_ground_as_well(comm: MPI.Comm) -> None:
    """A floor close below carries a part of the weight, and frame and floor all of it."""
    floor = Ground((0.0, 0.0, -0.008))
    solver = sheet_with_ball(comm, floor)
    found = solver.solve(plain(solver), 0.0)
    contact = solver.model.contact
    frame = solver.reactions(found).sum(axis=0)
    # The barrier's gradient on all vertices: minus the floor's force, all else is in pairs.
    by_floor = -contact.forces(found.state).sum(axis=0)
    assert frame + by_floor == pytest.approx(np.array([0, 0, WEIGHT]), abs=1e-8 * WEIGHT)
    assert by_floor[2] > 0.1 * WEIGHT
    assert frame[2] > 0.1 * WEIGHT


def test_a_ball_that_has_turned_far_starts_from_less(
    solver: EquilibriumSolver, lying: Equilibrium
) -> None:
    """A whole turn more is the same place; the solver takes it out."""
    model, comm = solver.model, solver.skin.comm
    turned = lying.state.copy()
    motions = comm.bcast(model.contact.motions(turned), root=0)
    vector = motions[0, 3:]
    radius = model.contact.contact.bodies[0].radius
    more = vector * (1 + 2 * np.pi * radius / np.linalg.norm(vector))
    if comm.rank == 0:
        turned[-3:] = more
    found = solver.solve(plain(solver), 0.0, start=turned)
    assert np.linalg.norm(found.poses[0][3:]) < np.pi
    assert np.array(found.poses) == pytest.approx(np.array(lying.poses), abs=1e-6)


def on_the_floor(
    comm: MPI.Comm, body: RigidBody, height: float | None
) -> tuple[EquilibriumSolver, Equilibrium]:
    """A body below a sheet, with the floor at a height in m."""
    pattern = square(n=2, size=SIZE)
    floor = None if height is None else Ground((0.0, 0.0, height))
    frame = clamp_where(pattern, lambda x: np.abs(x[:, :2] - SIZE / 2).max(axis=1) > 0.03)
    contact = Contact(ground=floor, bodies=[body])
    solver = EquilibriumSolver(sew(comm, pattern), Composite(), frame, contact=contact)
    return solver, solver.solve(plain(solver), 0.0, raise_on_failure=False)


def test_motions_that_nothing_resists(comm: MPI.Comm) -> None:
    """A tilted box falls on a side and does not slide; a ball finds a facet to lie on."""
    box = rigid_box("box", (0.02,) * 3, (0.04, 0.04, -0.02), mass=MASS, edge_length=0.01)
    box = box.moved(np.array([0.0, 0.0, 0.0, 0.2, 0.1, 0.0]))
    ball = rigid_sphere("ball", 0.01, (0.04, 0.04, -0.02), mass=MASS, edge_length=4e-3)
    for body, height in ((box, -0.034), (ball, -0.031)):
        solver, found = on_the_floor(comm, body, height)
        assert found.converged, found.reason
        contact = solver.model.contact
        forces = contact.forces(found.state)
        assert -forces.sum(axis=0) == pytest.approx(np.array([0, 0, WEIGHT]), abs=1e-8 * WEIGHT)
        assert found.poses[0][:2] == pytest.approx([0.0, 0.0], abs=1e-7)
        assert np.linalg.norm(found.poses[0][3:5]) > 0.1


def test_a_body_that_nothing_holds(comm: MPI.Comm) -> None:
    ball = rigid_sphere("ball", 0.01, (0.04, 0.04, -0.02), mass=MASS, edge_length=4e-3)
    _, found = on_the_floor(comm, ball, None)
    assert not found.converged
    assert found.reason.startswith("A free body falls at the weight of bodies: it")
    assert found.steps < 100
