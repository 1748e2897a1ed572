"""Bodies and supports that are moved: cold, from a result, along paths, on finer meshes."""

import json

import numpy as np
import pytest
from helpers.scenes import square
from helpers.standing import solver_on_base
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import ParameterError
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError, critical_load
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths import arc_length
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes import cylinder, sew

DOWN = np.array([[0.0, 0.0, -0.012, 0.0, 0.0, 0.0]])  # m, of a ball on a taut sheet


class Drum:
    """A stretched sheet in a frame, with a ball above it."""

    def __init__(self, comm: MPI.Comm) -> None:
        size, stretch = 0.08, 1.05
        middle = stretch * size / 2
        flat = square(n=8, size=size).flat_points
        self.pattern = square(np.pad(stretch * flat, ((0, 0), (0, 1))), n=8, size=size)
        frame = tf.clamp_where(
            self.pattern, lambda x: np.abs(x[:, :2] - middle).max(axis=1) > 0.999 * middle
        )
        ball = rigid_sphere("ball", 0.02, (middle, middle, 0.0213), edge_length=4e-3)
        skin, touched = sew(comm, self.pattern), Contact(bodies=[ball])
        self.solver = EquilibriumSolver(skin, Composite(), frame, contact=touched)
        self.plain = np.zeros(len(skin.owned_cells))

    def depth(self, found: Equilibrium) -> float:
        return float(self.solver.skin.gather_vertices(found.positions)[:, 2].min())


@pytest.fixture(scope="module")
def drum(alone: MPI.Comm) -> Drum:
    return Drum(alone)


@pytest.fixture(scope="module")
def pushed(drum: Drum) -> Equilibrium:
    return drum.solver.solve(drum.plain, Load(poses=DOWN))


def test_a_cold_start_lets_the_sheet_rest_and_carries_the_ball(
    drum: Drum, pushed: Equilibrium
) -> None:
    assert pushed.poses == (tuple(DOWN[0]),)
    assert drum.depth(pushed) < -0.01
    rest = drum.solver.solve(drum.plain, 0.0)
    carried = drum.solver.solve(drum.plain, Load(poses=DOWN), start=rest)
    assert pushed.energy == pytest.approx(carried.energy, rel=1e-6)


def test_an_earlier_result_is_a_start_whatever_came_between(
    drum: Drum, pushed: Equilibrium
) -> None:
    rest = drum.solver.solve(drum.plain, 0.0)
    for amount in (0.01, 0.02):
        drum.solver.solve(drum.plain + amount, 0.0)
    again = drum.solver.solve(drum.plain, Load(poses=DOWN), start=rest)
    assert again.energy == pytest.approx(pushed.energy, rel=1e-6)


def test_a_path_from_a_result_leaves_bodies_where_they_are(drum: Drum, pushed: Equilibrium) -> None:
    (point,) = trace(drum.solver, drum.plain, [0.0], start=pushed)
    assert point.result.poses == pushed.poses
    assert drum.depth(point.result) == pytest.approx(drum.depth(pushed), rel=1e-6)


def test_no_critical_load_where_bodies_move(drum: Drum, pushed: Equilibrium) -> None:
    """A part of the load would put them into the skin."""
    drum.solver.tangent_at(pushed)
    assert critical_load(drum.solver.model, drum.solver._factor, pushed.point) is None


def test_a_part_of_the_weight_is_restored(alone: MPI.Comm) -> None:
    skin = sew(alone, cylinder(alone, 0.15, 0.02, 9e-3, mesh="structured"))
    solver, other = (solver_on_base(skin, weight=tf.Weight(0.2, 0.6)) for _ in range(2))
    density = np.zeros(len(solver.skin.owned_cells))
    found = solver.solve(density, Load(1e3, weight_fraction=0.25))
    unknowns, numbers = solver.save(found)
    read = other.restore(density, unknowns, json.loads(json.dumps(numbers)))
    assert other.reactions(read) == pytest.approx(solver.reactions(found), abs=1e-9)
    # Under another load it is no equilibrium, and is solved for again.
    numbers["weight_fraction"] = 1.0
    heavier = other.restore(density, unknowns, numbers)
    assert heavier.steps > 0
    assert heavier.residual < 1e-9
    assert other.reactions(heavier).sum() != pytest.approx(other.reactions(read).sum(), rel=0.1)


def test_a_path_by_arc_length_without_a_first_point_says_so(
    drum: Drum, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arc_length._ArcLength, "_factorise", lambda *_: None)
    force = np.zeros(drum.pattern.points.shape)
    force[:, 2] = -1e-3
    path = trace(drum.solver, drum.plain, Load(force=force), by="arc-length")
    with pytest.raises(EquilibriumError, match="no first point at load factor 0.05: the tangent"):
        next(path)


def test_what_one_rank_alone_has_is_refused_on_all(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.05, 0.02, 9e-3, mesh="structured")
    skin = sew(comm, pattern)
    solver = solver_on_base(skin)
    force = np.zeros(pattern.points.shape)
    force[3, 2] = np.nan if comm.rank == 0 else 0.0
    with pytest.raises(ParameterError, match="force"):
        solver.solve(np.zeros(len(skin.owned_cells)), Load(1e3, force))


def test_an_equilibrium_of_another_skin_is_refused_on_all_ranks(comm: MPI.Comm) -> None:
    made = []
    for edge in (9e-3, 6e-3):
        skin = sew(comm, cylinder(comm, 0.05, 0.02, edge, mesh="structured"))
        solver = solver_on_base(skin)
        made.append((solver, solver.solve(np.zeros(len(skin.owned_cells)), 1e3)))
    (solver, own), (_, foreign) = made
    with pytest.raises(ParameterError, match="no stable equilibrium of this solver"):
        solver.reactions(foreign)
    with pytest.raises(ParameterError, match="start has shape"):
        solver.solve(own.density, 1e3, start=foreign)
    assert solver.reactions(own).any()
