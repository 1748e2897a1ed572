"""Paths with friction: sticking, sliding, held loads, steps, and what a cold solve begins from."""

import json

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.base.validation import Floats
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.bodies import Ground
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.solids import rigid_box
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import clamp_where
from toros_fem.meshes import sew

pytest.importorskip("ipctk")

FRICTION, THICKNESS, DISTANCE, SLIP = 0.5, 5e-4, 1e-4, 1e-4


def contact(normal: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Contact:
    return Contact(
        Ground(normal=normal),
        self_contact=False,
        friction=FRICTION,
        thickness=THICKNESS,
        distance=DISTANCE,
        slip=SLIP,
    )


class Dragged:
    """A sheet on the ground, pressed down by dead forces and dragged by one edge."""

    def __init__(self, comm: MPI.Comm) -> None:
        points = square(n=4).points.copy()
        points[:, 2] = THICKNESS / 2 + 0.9 * DISTANCE
        pattern = square(points, n=4)
        edge = clamp_where(pattern, lambda x: x[:, 0] < 1e-9)
        self.skin = sew(comm, pattern)
        self.solver = EquilibriumSolver(self.skin, Composite(), edge, contact=contact())
        self.density = np.ones(len(self.skin.owned_cells))
        self.force = np.tile([0.0, 0.0, -0.005], (len(points), 1))

    def __call__(
        self, ahead: float, start: Equilibrium | Floats | None = None, *, trial: bool = False
    ) -> Equilibrium:
        way = np.tile([-ahead, 0.0, 0.0], (len(self.force), 1))
        load, before = Load(0.0, self.force, way), isinstance(start, Equilibrium)
        given = {"after" if before else "start": start}
        return self.solver.solve(self.density, load, trial=trial, **given)  # type: ignore[arg-type]

    def pull(self, at: Equilibrium) -> float:
        """Force in N by which the edge pulls."""
        return float(-self.solver.reactions(at)[:, 0].sum())

    def weight(self, at: Equilibrium) -> float:
        """Force in N that presses on the ground."""
        return float(-self.solver.reactions(at)[:, 2].sum() - self.force[:, 2].sum())


@pytest.fixture(scope="module")
def dragged(alone: MPI.Comm) -> Dragged:
    return Dragged(alone)


def test_a_dragged_sheet_slides_under_full_friction(dragged: Dragged) -> None:
    at = dragged(0.0)
    for ahead in (2e-4, 4e-4, 8e-4):
        at = dragged(ahead, at)
    assert dragged.pull(at) == pytest.approx(FRICTION * dragged.weight(at), rel=1e-6)
    assert at.residual < 1e-9
    back = dragged(4e-4, at)
    assert dragged.pull(back) == pytest.approx(-FRICTION * dragged.weight(back), rel=1e-6)


@pytest.mark.parametrize("ahead", [3e-5, 4e-4])
def test_a_held_load_does_not_creep(dragged: Dragged, ahead: float) -> None:
    """Sticking and sliding: 50 steps under one load."""
    at = dragged(ahead, dragged(0.0))
    first = at.state.copy()
    pull = dragged.pull(at)
    for _ in range(50):
        at = dragged(ahead, at)
    assert np.abs(at.state - first).max(initial=0.0) < 1e-6 * SLIP
    assert dragged.pull(at) == pytest.approx(pull, rel=1e-6)


def test_a_start_is_no_begin_of_the_path(dragged: Dragged) -> None:
    """Arrays tell where the iteration starts: friction begins at the assembled positions."""
    cold = dragged(2e-4)
    again = dragged(2e-4, dragged(4e-4, dragged(0.0)).state)
    assert np.abs(again.state - cold.state).max(initial=0.0) < 1e-6 * SLIP


def test_a_trial_is_finished_from_the_same_begin(dragged: Dragged) -> None:
    before = dragged(1e-4, dragged(0.0))
    whole = dragged(3e-4, before)
    finished = dragged.solver.finish(dragged(3e-4, before, trial=True))
    assert np.abs(finished.state - whole.state).max(initial=0.0) < 1e-6 * SLIP


def test_saved_and_restored(alone: MPI.Comm) -> None:
    """An equilibrium with friction on a moved body, on its way through a file."""
    pattern = square(n=3)
    above = THICKNESS / 2 + 0.7 * DISTANCE
    box = rigid_box("box", (0.01, 0.01, 0.006), (0.012, 0.011, 0.003 + above))
    touched = Contact(
        bodies=[box],
        self_contact=False,
        friction=FRICTION,
        thickness=THICKNESS,
        distance=DISTANCE,
    )
    edge = clamp_where(pattern, lambda x: x[:, 0] < 1e-9)
    solver = EquilibriumSolver(sew(alone, pattern), Composite(), edge, contact=touched)
    density = np.ones(len(solver.skin.owned_cells))
    force = np.tile([0.0, 2e-3, 1e-2], (len(pattern.points), 1))
    poses = np.array([[0.0, 0.0, 2e-4, 0.0, -0.02, 0.1]])
    before = solver.solve(density, Load(0.0, force=force, poses=poses))
    found = solver.solve(density, Load(0.0, force=2 * force, poses=poses), after=before)
    unknowns, numbers = solver.save(found)
    restored = solver.restore(
        density, unknowns, json.loads(json.dumps(numbers)), Load(force=2 * force)
    )
    assert restored.poses == found.poses
    assert np.array_equal(restored.sliding, found.sliding)
    again = solver.solve(density, Load(0.0, force=2 * force, poses=poses), after=restored)
    assert again.steps == 0
    assert np.abs(again.state - found.state).max(initial=0.0) < 1e-6 * SLIP
