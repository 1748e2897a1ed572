"""Where a solve starts, the ways that it tries, and how it goes on by increments."""

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.newton import Attempt, NewtonOptions
from toros_fem.mechanics.equilibrium.search import (
    ContinuationResult,
    PrescribedDisplacement,
    run_continuation,
)
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.meshes import Skin, sew
from toros_fem.meshes.sheets import disc

RADIUS = 0.02


def mylar(comm: MPI.Comm) -> tuple[Skin, EquilibriumSolver, float]:
    """Half of two stiff discs sewn along their border, flat, and a pressure that hardly strains."""
    pattern = disc(comm, RADIUS, RADIUS / 6, "structured")
    points = pattern.points
    border = np.unique(pattern.free_edges)
    fixed = symmetry_plane(pattern, 2).fixed
    for direction, axis in (((-1, 0), 1), ((1, 0), 1), ((0, 1), 0)):
        fixed[border[np.argmax(points[border, :2] @ direction)], axis] = True
    stiff = Material(1e6, 0.3, 1e-3)
    composite = Composite(fabric=stiff, reinforcement=stiff, c1=1.8, c2=2.0, bending=None)
    skin = sew(comm, pattern)
    pressure = stiff.membrane_stiffness / (200 * RADIUS)
    return skin, EquilibriumSolver(skin, composite, Supports(fixed)), pressure


def test_a_flat_skin_is_opened_first(alone: MPI.Comm) -> None:
    """Started from the first crumples it stays there, with two thirds of the volume."""
    skin, solver, pressure = mylar(alone)
    density = np.zeros(len(skin.owned_cells))
    opened = solver.solve(density, pressure)
    lift = solver.model.assembled
    flat = np.linalg.norm(skin.pattern.points[skin.owned_vertices, :2], axis=1)
    solver.model.positions(lift)[:, 2] += 1e-3 * RADIUS * (1 - (flat / RADIUS) ** 2)
    crumpled = solver.solve(density, pressure, start=lift)
    assert opened.energy < 1.3 * crumpled.energy < 0
    assert opened.volume > 1.2 * crumpled.volume


SIZE = 0.02


@pytest.fixture(scope="module")
def strip(alone: MPI.Comm) -> SkinModel:
    """A flat sheet with two opposite borders fixed."""
    pattern = square(size=SIZE)
    x = pattern.points[:, 0]
    ends = (x < 1e-9) | (x > SIZE * (1 - 1e-9))
    fixed = np.repeat(ends[:, None], 3, axis=1)
    return make_model(sew(alone, pattern), Composite(bending=None), Supports(fixed))


def test_a_pulled_strip_is_stretched_evenly(strip: SkinModel) -> None:
    points = strip.skin.pattern.points
    moves = np.where(points[:, :1] > SIZE / 2, [[0.3 * SIZE, 0.0, 0.1 * SIZE]], 0.0)
    pull = Load(displacement=moves)
    place = PrescribedDisplacement(strip)
    moved = strip.skin.gather_vertices(strip.positions(place(strip.assembled, pull)))
    assert moved == pytest.approx(points + points[:, :1] * [0.3, 0.0, 0.1], abs=1e-7 * SIZE)
    # From there, back to the assembled positions.
    state = place(place(strip.assembled, pull), Load())
    assert strip.skin.gather_vertices(strip.positions(state)) == pytest.approx(
        points, abs=1e-7 * SIZE
    )


def test_free_components_keep_their_place_where_nothing_jumps(strip: SkinModel) -> None:
    state = strip.assembled
    state[strip.free] += 1e-3 * SIZE
    placed = PrescribedDisplacement(strip)(state, Load())
    assert np.array_equal(placed, state)


def test_supports_that_stay_cost_no_solves(alone: MPI.Comm) -> None:
    """A load without an equilibrium fails as soon with displacements of zero as without any."""
    pattern = square(size=SIZE, n=4)
    fixed = np.repeat(pattern.points[:, :1] < 0.3 * SIZE, 3, axis=1)
    options = NewtonOptions(max_steps=2, min_increment=1.0)
    solver = EquilibriumSolver(sew(alone, pattern), Composite(), Supports(fixed), options)
    density = np.zeros(len(solver.skin.owned_cells))
    force = np.zeros_like(pattern.points)
    force[pattern.points[:, 0] > SIZE * (1 - 1e-9), 0] = 0.05
    still = np.zeros_like(force)
    steps = [
        solver.solve(density, Load(0.0, force, displacement=of), raise_on_failure=False).steps
        for of in (None, still)
    ]
    assert 0 < steps[1] <= steps[0] + 2 * 2


def continued(limit: float, *, jump: float = 1.0) -> tuple[ContinuationResult, list[float]]:
    """Continue where an attempt succeeds up to a limit, and if it jumps no further than that."""
    tried: list[float] = []

    def attempt(state: np.ndarray, level: float) -> Attempt:
        tried.append(level)
        good = level <= limit and level - state[0] <= jump
        return Attempt(np.array([level]), 2, 5) if good else Attempt(state + np.nan, -5, 5)

    begin = ContinuationResult(np.zeros(1), None, 0)
    return run_continuation(attempt, begin, 0.25, 0.05), tried


def test_it_reaches_the_top() -> None:
    end, tried = continued(10.0)
    assert (end.load_factor, end.outcome, end.state[0]) == (1.0, 2, 1.0)
    assert tried == [0.25, 1.0]


def test_increments_shrink() -> None:
    end, tried = continued(10.0, jump=0.3)
    assert end.load_factor == end.state[0] == 1.0
    assert len(tried) < 9


def test_the_last_good_level_is_kept() -> None:
    end, tried = continued(0.7)
    assert end.outcome < 0
    assert 0.7 - 0.05 <= end.load_factor <= 0.7
    assert end.state[0] == end.load_factor
    assert len(tried) < 20


def test_no_level_is_ever_reached() -> None:
    end, tried = continued(-1.0)
    assert end.load_factor is None
    assert end.state[0] == 0.0
    assert len(tried) < 5


def test_many_steps_slow_the_increments_down() -> None:
    """A level that took more than ten steps only doubles the next increment."""
    tried: list[float] = []

    def attempt(state: np.ndarray, level: float) -> Attempt:
        tried.append(level)
        return Attempt(np.array([level]), 2, 11)

    run_continuation(attempt, ContinuationResult(np.zeros(1), None, 0), 0.125, 0.05)
    assert tried == [0.125, 0.375, 0.875, 1.0]
