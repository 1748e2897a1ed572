"""Design problems of tiles: their parts, distribution over ranks, short runs."""

import time

import numpy as np
import pytest
from helpers.tiles import (
    CONTRAST,
    DIRECTIONS,
    EDGES,
    RADIUS,
    SIDE,
    SMALL,
    TARGET,
    profile_solver,
    small_case,
    tile_of,
)
from kit.pairs import tile_problem as tile_problem_of
from mpi4py import MPI

from toros_fem import errors
from toros_fem.design.density.filters import cone_filter, group_mean
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage
from toros_fem.products.tiles.problem import TileProblem, tile_problem
from toros_fem.products.tiles.stiffness_profile import (
    ProfileObjective,
    ProfileTarget,
)


def start_of(problem: TileProblem) -> np.ndarray:
    """Return a symmetric density with noise."""
    x, y = (2 * np.pi * problem.skin.pattern.centroids / SIDE).T
    noise = np.random.default_rng(2).uniform(-1, 1, len(x))
    every = 0.5 + 0.3 * np.cos(x) * np.cos(y) + 0.15 * noise
    return np.asarray(every[problem.skin.owned_cells])


def make_problem(
    batched: bool,
    objective: ProfileObjective,
    symmetry: str = "tetragonal",
    angles: np.ndarray = DIRECTIONS,
    beta: float = 4.0,
) -> TileProblem:
    solver, found = profile_solver(batched, angles), tile_of(EDGES)
    skin = solver.tile.skin
    inner = cone_filter(skin, RADIUS, found.lattice)
    symmetric = inner.after(group_mean(skin, found.symmetry_maps(symmetry)))
    fields = DensityFields(skin, symmetric, Projection(beta))
    return TileProblem(fields, solver, objective)


def test_ranks_that_share_directions_have_equal_gradients(comm: MPI.Comm) -> None:
    """To the last digit, since each has an MMA of its own; contracts/test_pairs has the rest."""
    problem = tile_problem_of(TARGET, "tetragonal", comm, batched=True)
    _, slopes = problem.evaluate(start_of(problem))
    rows = slopes.residuals.gradients
    for theirs, others in comm.allgather((slopes.gradient, rows)):
        assert (theirs == slopes.gradient).all()
        assert np.array_equal(others, rows)


THREE = np.array([0.0, np.pi / 8, np.pi / 4])


def test_objective_of_zero() -> None:
    """T = 0 cannot be scaled: at the start, and on the way."""
    problem = make_problem(True, ProfileTarget(np.full(3, 1e3)), angles=THREE)
    start = np.round(start_of(problem), 3)  # as the loop rounds its variables
    there = problem.simulate(start).equilibrium
    reached = problem.changed(objective=ProfileTarget(there.stiffness))
    result = optimize(reached, DesignOptions((Stage(2),)), start=start)
    assert result.final.objective < 1e-20
    assert result.density == pytest.approx(start, abs=1e-6)
    near = problem.changed(objective=ProfileTarget(1.01 * there.stiffness))
    result = optimize(near, DesignOptions((Stage(12),), x_tol=1e-9), start=start)
    assert result.final.objective < 1e-12
    assert np.isfinite(result.density).all()


def test_metric_of_a_target() -> None:
    """The largest deviation from the target is a metric of the history, whatever the objective."""
    target = ProfileTarget(np.array([900.0, 1200.0, 2400.0]))
    problem = make_problem(True, target, angles=THREE).changed(goal=target)
    other = problem.changed(objective=ProfileTarget(np.full(3, 1e3)))
    result = optimize(other, [Stage(1)], start=start_of(problem))
    stiffness = result.final.equilibrium.stiffness
    worst = np.abs(stiffness / [900.0, 1200.0, 2400.0] - 1).max()
    assert result.history[-1].metrics == {"worst_percent": pytest.approx(100 * worst, rel=1e-12)}
    assert make_problem(True, CONTRAST).metrics_of(result.final.equilibrium) == {}


def test_ranks_that_share_directions_stop_together(
    comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The slowest rank decides on the time limit; here the last one's clock jumps ahead."""
    problem, clock, jump = make_problem(True, TARGET), time.perf_counter, [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock() + jump[0])

    def late(row: Iteration, _: object) -> None:
        if row.iteration == 1 and comm.rank == comm.size - 1:
            jump[0] = 1e6

    options = DesignOptions((Stage(1),), seconds=1e5)
    found = optimize(problem, options, start=start_of(problem), callback=late)
    assert comm.allgather(found.reason) == comm.size * ["100000 s have passed."]


def test_parts_of_the_problem(alone: MPI.Comm) -> None:
    """Only requested parts are built, with the numbers of the configuration."""
    case = small_case(alone)
    config = SMALL.updated(constrained=False, beta=7.0, eta=0.4)
    plain = tile_problem(case, config)
    assert not plain.terms
    assert plain.length_scale is None
    assert (plain.fields.projection.beta, plain.fields.projection.eta) == (7.0, 0.4)
    assert plain.fields.filter.radius == 2e-3
    assert plain.fields.filter.name == "cone"
    assert plain.goal is case.objective
    assert plain.physics.strain == 0.1
    assert plain.physics.angles == pytest.approx(np.radians([0, 15, 30, 45]))
    whole = tile_problem(
        case, SMALL.updated(filter="helmholtz", perimeter_weight=1e-3, line_width=2.2e-3)
    )
    (term,) = whole.terms
    assert term.price == 1e-3 / case.tile.pattern.size
    assert whole.fields.filter.name == "helmholtz"
    same = tile_problem(case, SMALL.updated(filter="helmholtz"))
    # A wider line has a higher threshold; the one for gaps stays.
    assert whole.length_scale.solid_threshold > same.length_scale.solid_threshold
    assert whole.length_scale.void_threshold == same.length_scale.void_threshold


def test_radius_of_a_small_tile(alone: MPI.Comm) -> None:
    with pytest.raises(errors.ParameterError, match="than twice the radius"):
        tile_problem(small_case(alone), SMALL.updated(filter_radius=6e-3))
