"""The chain from density to objective: gradients, ranks, errors."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from helpers.designs import full, problem
from mpi4py import MPI

from toros_fem import errors
from toros_fem._mpi import norm
from toros_fem.density.field import random_density
from toros_fem.design.loop import optimize
from toros_fem.design.options import DesignOptions, Stage
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumResult, EquilibriumSolver
from toros_fem.materials import Composite
from toros_fem.mechanics.supports import clamp
from toros_fem.meshes import Skin, cylinder, sew
from toros_fem.objectives.shape import ShapeObjective


def test_objective_by_hand(tube: Skin) -> None:
    target = tube.pattern.points + [0.003, 0.0, 0.004]
    state = tube.pattern.points[tube.owned_vertices]
    value = ShapeObjective(tube, target).forward(state)
    assert value == pytest.approx(0.5 * (0.005 / tube.pattern.size) ** 2, rel=1e-12)
    only = (tube.pattern.points[:, 2] > 0.059).astype(float)
    away = np.where(only[:, None] > 0, tube.pattern.points + [0, 0.001, 0], 7.0)
    value = ShapeObjective(tube, away, only).forward(state)
    assert value == pytest.approx(0.5 * (0.001 / tube.pattern.size) ** 2, rel=1e-12)


def test_relative_objective_sees_turning_and_not_place(tube: Skin, comm: MPI.Comm) -> None:
    """A part that is moved as it is costs nothing; turned, it costs by its own extent."""
    pattern = tube.pattern
    tip = (pattern.points[:, 2] > 0.059).astype(float)
    objective = ShapeObjective(tube, pattern.points, np.full(len(tip), 1e-12), tip)
    own = tube.owned_vertices
    moved = pattern.points + [0.01, 0.02, 0.0]
    assert objective.forward(moved[own]) < 1e-9 * objective.forward(0 * moved[own])
    weight = tip * pattern.vertex_areas
    gap = np.random.default_rng(0).normal(size=pattern.points.shape)
    gap -= weight @ gap / weight.sum()
    expected = 0.5 * weight @ (gap**2).sum(axis=1)
    expected /= 1e-12 * pattern.vertex_areas.sum() * pattern.size**2
    state = (moved + gap)[own]
    assert objective.forward(state) == pytest.approx(expected, rel=1e-9)
    direction = np.random.default_rng(1).normal(size=pattern.points.shape)[own]
    slope = comm.allreduce(float((objective.backward(state) * direction).sum()))
    ends = [objective.forward(state + h * direction) for h in (1e-4, -1e-4)]
    assert slope == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-7)


def test_taylor_of_the_whole_chain(
    tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm
) -> None:
    """Filter, projection, equilibrium with bending under pressure, objective: rate 2."""
    chain = problem(tube, tube_solver)
    density = random_density(tube, 2, spread=0.3)
    base = chain.evaluate(density)
    assert base.gradient is not None
    start = base.equilibrium.state
    direction = np.random.default_rng(9).uniform(-1, 1, len(tube.pattern.panel))[tube.owned_cells]
    slope = comm.allreduce(float(base.gradient @ direction))
    gaps = []
    for step in 1e-2 * 0.5 ** np.arange(6):
        there = chain.simulate(density + step * direction, start)
        gaps.append(abs(there.objective - base.objective - step * slope))
    rates = np.log2(np.array(gaps[:-1]) / gaps[1:])
    assert rates[-4:] == pytest.approx(2, abs=0.05)
    # The part that is linear must matter, or the rate would show nothing.
    assert abs(slope) * 1e-2 > 10 * gaps[0]


def test_taylor_of_everything_by_density_and_pressure(
    tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm
) -> None:
    """T with its perimeter term, and both constraints, along a joint step of ρ and P."""
    chain = full(tube, tube_solver)
    density = random_density(tube, 2, spread=0.3)
    base = chain.evaluate(density)
    assert base.gradient is not None
    assert base.pressure_gradient is not None
    assert base.length_scale is not None
    assert base.length_scale_gradients is not None
    drawn = np.random.default_rng(9).uniform(-1, 1, len(tube.pattern.panel))[tube.owned_cells]
    direction, pressure = drawn * chain.designed, 4e3
    along = lambda g: comm.allreduce(float(g @ direction))  # noqa: E731
    by_pressure = base.pressure_gradient[0] * pressure
    slopes = [along(base.gradient) + by_pressure, *map(along, base.length_scale_gradients)]
    assert abs(by_pressure) > 1e-2 * abs(slopes[0]), "the pressure must matter"
    gaps = []
    for step in 1e-2 * 0.5 ** np.arange(6):
        there = chain.simulate(
            density + step * direction, base.equilibrium.state, chain.pressures[0] + step * pressure
        )
        assert there.length_scale is not None
        values = np.array([there.objective - base.objective,
                           *(there.length_scale - base.length_scale)])  # fmt: skip
        gaps.append(np.abs(values - step * np.array(slopes)))
    rates = np.log2(np.array(gaps[:-1]) / gaps[1:])
    assert rates[-3:] == pytest.approx(2, abs=0.1)


def test_pressure_gradient_alone(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    chain = full(tube, tube_solver)
    density = random_density(tube, 2, spread=0.3)
    base = chain.evaluate(density, pressure=3e3)
    assert base.equilibrium.pressure == 3e3
    state = base.equilibrium.state
    there, back = (chain.simulate(density, state, 3e3 + s).objective for s in (1.0, -1.0))
    assert base.pressure_gradient == pytest.approx((there - back) / 2, rel=1e-4)


def test_what_is_not_asked_for_is_not_there(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    plain = problem(tube, tube_solver).evaluate(random_density(tube, 0))
    assert plain.perimeter is None
    assert plain.length_scale is None
    assert plain.pressure_gradient is None
    assert plain.objective == plain.shape
    unweighted = dataclasses.replace(full(tube, tube_solver), perimeter=None, perimeter_weight=None)
    assert unweighted.simulate(random_density(tube, 0)).perimeter is None
    with_it = full(tube, tube_solver).simulate(random_density(tube, 0))
    assert with_it.perimeter is not None
    size = tube.pattern.size
    expected = with_it.shape + 1e-4 * with_it.perimeter / size
    assert with_it.objective == pytest.approx(expected, rel=1e-14)


def test_stages_switch_constraints_on_and_pressure_moves(
    tube: Skin, tube_solver: EquilibriumSolver
) -> None:
    chain = dataclasses.replace(
        full(tube, tube_solver, beta=20.0), perimeter=None, perimeter_weight=None
    )
    stages = (Stage(6), Stage(12, constrained=True))
    result = optimize(chain, DesignOptions(stages), start=random_density(tube, 3))
    free, last = result.history[6], result.history[-1]
    assert free.stage == 0
    assert last.stage == 1
    assert max(free.g_r, free.g_t) > 10 * max(last.g_r, last.g_t), "constraints act"
    assert last.grey_level < 0.5 * free.grey_level
    assert result.pressure == last.pressure == result.final.equilibrium.pressure
    assert result.pressure != chain.pressure
    assert min(row.pressure for row in result.history) >= 1e3
    steps = np.diff(np.log([row.pressure for row in result.history])) / np.log(20)
    assert np.abs(steps).max() <= 0.1 + 1e-9


def test_a_run_goes_on_from_a_result(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    chain = full(tube, tube_solver, beta=20.0)
    first = optimize(chain, DesignOptions((Stage(4),)), start=random_density(tube, 3))
    more = optimize(chain, DesignOptions((Stage(3),)), start=first.density, after=first)
    assert [row.iteration for row in more.history] == [0, 1, 2, 3, 4, 4, 5, 6, 7]
    assert [row.stage for row in more.history] == [0] * 5 + [1] * 4
    assert more.history[5].objective == pytest.approx(first.final.objective, rel=1e-9)
    assert more.history[:5] == first.history
    assert more.final.objective < first.final.objective
    assert more.seconds["equilibrium"] > first.seconds["equilibrium"]


def test_a_run_goes_on_on_another_mesh(
    tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm
) -> None:
    """Its history goes on, its shape does not fit."""
    first = optimize(
        problem(tube, tube_solver), DesignOptions((Stage(2),)), start=random_density(tube, 3)
    )
    pattern = cylinder(comm, 0.06, 0.02, 5e-3)
    other = sew(comm, pattern)
    assert len(pattern.panel) != len(tube.pattern.panel)
    chain = problem(other, EquilibriumSolver(other, Composite(), clamp(pattern, ["base"])))
    more = optimize(
        chain,
        DesignOptions((Stage(1),)),
        start=random_density(other, 3),
        after=first,
        new_mesh=True,
    )
    assert [row.iteration for row in more.history] == [0, 1, 2, 2, 3]
    assert len(more.density) == len(other.owned_cells)


def test_a_design_that_is_good_enough_ends_a_stage(
    tube: Skin, tube_solver: EquilibriumSolver
) -> None:
    """And not while its constraints are violated."""
    chain, start = full(tube, tube_solver, beta=20.0), random_density(tube, 3)
    every = optimize(chain, DesignOptions((Stage(5),)), start=start).history
    enough = every[2].objective * 1.001
    first = next(k for k, row in enumerate(every) if row.objective <= enough)
    found = optimize(
        chain, DesignOptions((Stage(5), Stage(5)), target_objective=enough), start=start
    )
    assert [row.stage for row in found.history] == [0] * (first + 1) + [1]
    assert found.reason == f"T is at most {enough:g}."
    bound = optimize(
        chain, DesignOptions((Stage(5, constrained=True),), target_objective=enough), start=start
    )
    assert chain.length_scale is not None
    solid, void = chain.length_scale.epsilon
    for row in bound.history[:-1]:
        assert row.objective > enough or row.g_r > solid or row.g_t > void
    assert any(row.objective <= enough for row in bound.history[:-1]), "constraints act"


def test_stages_that_are_alike_all_run(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    """And what is reported last is the design returned, also when a stage ends at its start."""
    chain, start = problem(tube, tube_solver), random_density(tube, 3)
    result = optimize(chain, DesignOptions((Stage(2),) * 3), start=start)
    assert [row.stage for row in result.history] == [0] * 3 + [1] * 3 + [2] * 3
    plain = 0 * start + 0.5
    late = optimize(chain, DesignOptions((Stage(2),), seconds=1e-3), start=plain, after=result)
    assert late.history[-1].objective == late.final.objective != result.final.objective


def test_stop_rules(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    chain, start = problem(tube, tube_solver), random_density(tube, 3)
    for options, reason in (
        (DesignOptions((Stage(9),), x_tol=0.5), "No variable changes by more than 0.5"),
        (DesignOptions((Stage(9),), kkt_tol=1e3), "The KKT residual is under 1000"),
        (DesignOptions((Stage(9),), seconds=1e-3), "0.001 s have passed"),
    ):
        result = optimize(chain, options, start=start)
        assert reason in result.reason
        assert len(result.history) < 4
    slow = optimize(chain, DesignOptions((Stage(14),), min_relative_decrease=1.0), start=start)
    assert slow.reason == "T fell by less than 1 of it in 10 steps."
    assert slow.history[-1].iteration == 10, "it never falls by all of it"
    with pytest.raises(errors.ParameterError, match="min_relative_decrease = 2"):
        DesignOptions(min_relative_decrease=2.0)
    with pytest.raises(errors.ParameterError, match="stages is empty"):
        DesignOptions(())
    with pytest.raises(errors.ParameterError, match="descent = 'steep'"):
        DesignOptions(descent="steep")


def test_conservative_steps_descend(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    options = DesignOptions((Stage(6),), descent="conservative", retries=15)
    result = optimize(problem(tube, tube_solver), options, start=random_density(tube, 3))
    objectives = [row.objective for row in result.history]
    assert objectives == sorted(objectives, reverse=True)
    assert objectives[-1] < 0.5 * objectives[0]


def test_binary_pattern_is_simulated_as_it_is(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    chain = problem(tube, tube_solver)
    design = chain.simulate(random_density(tube, 3, spread=0.5))
    printed = design.filtered > 0.5
    binary = chain.simulate_binary(printed, design)
    assert set(np.unique(binary.projected)) <= {0.0, 1.0}
    assert np.array_equal(binary.projected[chain.designed] > 0.5, printed[chain.designed])
    assert np.all(binary.projected[~chain.designed] == 1)
    assert binary.equilibrium.pressure == design.equilibrium.pressure
    assert binary.shape != design.shape


def test_bad_pressure_bounds(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    chain = problem(tube, tube_solver)
    with pytest.raises(errors.ParameterError, match=r"pressure = 5000.0 .* between 6000"):
        dataclasses.replace(chain, pressure_bounds=(6e3, 2e4))
    with pytest.raises(errors.ParameterError, match="leave it no room"):
        dataclasses.replace(chain, pressure_bounds=(5e3, 5e3))
    constrained = DesignOptions((Stage(1, constrained=True),))
    with pytest.raises(errors.ParameterError, match="problem has no length_scale"):
        optimize(problem(tube, tube_solver), constrained, start=random_density(tube, 0))
    with pytest.raises(errors.ParameterError, match="iterations = 2.5"):
        Stage(2.5)  # type: ignore[arg-type]
    with pytest.raises(errors.ParameterError, match="retries = -1"):
        DesignOptions(retries=-1)
    with pytest.raises(errors.ParameterError, match="least_pressure = 0"):
        dataclasses.replace(chain, pressure_bounds=(0.0, 2e4))


def test_bending_matters_in_the_taylor_state(
    tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm
) -> None:
    """Bending is active there: without it the gradient is another one."""
    plain = EquilibriumSolver(
        tube, dataclasses.replace(Composite(), bending=None), clamp(tube.pattern, ["base"])
    )
    density = random_density(tube, 2, spread=0.3)
    with_it = problem(tube, tube_solver).evaluate(density).gradient
    without = problem(tube, plain).evaluate(density).gradient
    assert with_it is not None
    assert without is not None
    assert norm(comm, with_it - without) > 1e-3 * norm(comm, with_it)


def test_gradient_against_central_differences(
    tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm
) -> None:
    chain = problem(tube, tube_solver)
    density = random_density(tube, 4, spread=0.3)
    base = chain.evaluate(density)
    assert base.gradient is not None
    gradient = tube.gather_cells(base.gradient)
    wall = tube.pattern.cells_of("wall")
    for cell in np.random.default_rng(1).choice(wall, 3, replace=False):
        values = []
        for sign in (1, -1):
            moved = density + sign * 1e-4 * (tube.owned_cells == cell)
            values.append(chain.simulate(moved, base.equilibrium.state).objective)
        difference = (values[0] - values[1]) / 2e-4
        assert gradient[cell] == pytest.approx(difference, rel=1e-4, abs=1e-9)


def test_given_cells_have_no_gradient(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    chain = problem(tube, tube_solver)
    result = chain.evaluate(random_density(tube, 0))
    assert result.gradient is not None
    caps = ~chain.designed
    assert np.all(result.gradient[caps] == 0)
    assert np.all(result.projected[caps] == 1)


def test_ranks_agree_over_ten_iterations(
    tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm
) -> None:
    if comm.size == 1:
        pytest.skip("needs two ranks to compare with one")
    spread = full(tube, tube_solver, beta=20.0)
    options = DesignOptions((Stage(6), Stage(4, constrained=True)))
    one = optimize(spread, options, start=random_density(tube, 3))
    alone = sew(MPI.COMM_SELF, tube.pattern)
    solver = EquilibriumSolver(alone, Composite(), clamp(alone.pattern, ["base"]))
    other = optimize(full(alone, solver, beta=20.0), options, start=random_density(alone, 3))
    first, last = one.history[0], one.history[-1]
    first_alone, last_alone = other.history[0], other.history[-1]
    assert first.objective == pytest.approx(first_alone.objective, rel=1e-9)
    assert first.gradient_norm == pytest.approx(first_alone.gradient_norm, rel=1e-9)
    assert last.objective == pytest.approx(last_alone.objective, rel=1e-6)
    assert last.gradient_norm == pytest.approx(last_alone.gradient_norm, rel=1e-6)
    assert last.pressure == pytest.approx(last_alone.pressure, rel=1e-6)
    assert last.g_r == pytest.approx(last_alone.g_r, rel=1e-5)


def test_loop_descends_and_is_reproducible(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    seen = []
    runs = [
        optimize(
            problem(tube, tube_solver),
            DesignOptions((Stage(6),)),
            start=random_density(tube, 3),
            callback=lambda row, _: seen.append(row.iteration),
        )
        for _ in range(2)
    ]
    objectives = [row.objective for row in runs[0].history]
    assert objectives[-1] < 0.2 * objectives[0]
    assert objectives == [row.objective for row in runs[1].history]
    assert seen == [*range(7)] * 2
    assert runs[0].reason == "All 6 iterations are done."
    assert runs[0].density.min() >= 0
    assert runs[0].density.max() <= 1


def test_a_design_without_equilibrium_is_stepped_back_from(
    tube: Skin, tube_solver: EquilibriumSolver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Failures of the solver on the way are retried; if they stay, the last design is kept."""
    chain = problem(tube, tube_solver)
    solve, count = tube_solver.solve, 0

    def failing(broken: range) -> Any:
        def patched(*args: Any, **kwargs: Any) -> EquilibriumResult:
            nonlocal count
            count += 1
            result = solve(*args, **kwargs)
            if count in broken:
                raise EquilibriumError("made to fail", result)
            return result

        return patched

    monkeypatch.setattr(tube_solver, "solve", failing(range(2, 4)))
    result = optimize(chain, DesignOptions((Stage(3),)), start=random_density(tube, 3))
    assert [row.iteration for row in result.history] == [0, 1, 2, 3]
    assert result.history[1].rejected >= 2
    count = 0
    monkeypatch.setattr(tube_solver, "solve", failing(range(3, 99)))
    result = optimize(chain, DesignOptions((Stage(3),)), start=random_density(tube, 3))
    assert [row.iteration for row in result.history] == [0, 1]
    assert "the last design with one" in result.reason
    assert result.final.objective == result.history[-1].objective


def test_continuation_raises_beta(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    chain = problem(tube, tube_solver)
    stages = [Stage(2, beta=beta) for beta in (2.0, 4.0, 8.0)]
    result = optimize(chain, stages, seed=3)
    # A row for the start of each stage, and one for each step.
    assert [row.beta for row in result.history] == [2, 2, 2, 4, 4, 4, 8, 8, 8]
    assert [row.stage for row in result.history] == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert [row.iteration for row in result.history] == [0, 1, 2, 2, 3, 4, 4, 5, 6]
    assert chain.projection.beta == 6.0, "the problem is left as it was"


def test_gradient_of_a_state_that_is_gone(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    chain = problem(tube, tube_solver)
    first = chain.simulate(random_density(tube, 0))
    chain.simulate(random_density(tube, 1))
    with pytest.raises(errors.ParameterError, match="another state"):
        chain.differentiate(first)


def test_bad_densities(tube: Skin, tube_solver: EquilibriumSolver, comm: MPI.Comm) -> None:
    chain = problem(tube, tube_solver)
    density = random_density(tube, 0)
    short = density[:-1] if comm.rank == comm.size - 1 else density
    with pytest.raises(errors.DensityError, match="shape"):
        optimize(chain, DesignOptions((Stage(1),)), start=short)
    with pytest.raises(errors.DensityError, match="passive has shape"):
        dataclasses.replace(chain, passive=short)
    with pytest.raises(errors.DensityError, match="none is designed"):
        dataclasses.replace(chain, passive=np.ones_like(density))
    with pytest.raises(errors.DensityError, match="from 2.0 to 2.0"):
        dataclasses.replace(chain, passive=np.where(density > 0.5, np.nan, 2.0))


def test_bad_targets(tube: Skin) -> None:
    points = tube.pattern.points
    with pytest.raises(errors.TargetError, match=f"has {len(points)} vertices"):
        ShapeObjective(tube, points[:-1])
    wrong = points.copy()
    wrong[11, 2] = np.nan
    with pytest.raises(errors.TargetError, match="target vertex 11"):
        ShapeObjective(tube, wrong)
    with pytest.raises(errors.ParameterError, match="weights"):
        ShapeObjective(tube, points, np.zeros(len(points)))
