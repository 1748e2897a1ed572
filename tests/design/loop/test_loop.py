"""The design loop: stages, stop rules, ranks, failures."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from helpers.designs import full, make_problem
from helpers.standing import solver_on_base

from toros_fem.design.loop.fields import random_density
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage, growth_of_miss
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_stages_switch_constraints_on_and_pressure_moves(tube: Skin) -> None:
    solver = solver_on_base(tube)
    problem = full(tube, solver, beta=20.0).changed(terms=())
    stages = (Stage(6), Stage(12, constrained=True))
    result = optimize(problem, DesignOptions(stages), start=random_density(tube, 3))
    free, last = result.history[6], result.history[-1]
    assert free.stage == 0
    assert last.stage == 1
    assert max(free.g_r, free.g_t) > 10 * max(last.g_r, last.g_t), "constraints act"
    assert last.grey_level < 0.55 * free.grey_level
    assert result.pressure == last.pressure == result.final.equilibrium.pressure
    assert result.pressure != problem.physics.pressure
    assert min(row.pressure for row in result.history) >= 1e3
    steps = np.diff(np.log([row.pressure for row in result.history]))
    assert np.abs(steps).max() <= np.log(1.07) + 1e-3 / 2 * np.log(20), "but for rounding"


def test_a_run_goes_on_from_a_result(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    problem = full(short_tube, short_solver, beta=20.0)
    first = optimize(problem, DesignOptions((Stage(4),)), start=random_density(short_tube, 3))
    more = optimize(problem, DesignOptions((Stage(3),)), start=first.density, after=first)
    assert [row.iteration for row in more.history] == [0, 1, 2, 3, 4, 4, 5, 6, 7]
    assert [row.stage for row in more.history] == [0] * 5 + [1] * 4
    assert more.history[5].objective == pytest.approx(first.final.objective, rel=1e-9)
    assert more.history[:5] == first.history
    started = short_tube.gather_cells(problem.fields.with_passive(random_density(short_tube, 3)))
    assert first.initial[1] == pytest.approx(started)
    assert more.initial is first.initial
    assert more.final.objective < first.final.objective
    assert more.seconds["equilibrium"] > first.seconds["equilibrium"]


def test_a_design_that_is_good_enough_ends_a_stage(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    """And not while its constraints are violated."""
    problem, start = full(short_tube, short_solver, beta=20.0), random_density(short_tube, 3)
    every = optimize(problem, DesignOptions((Stage(2),)), start=start).history
    enough = every[2].objective * 1.001
    first = next(k for k, row in enumerate(every) if row.objective <= enough)
    found = optimize(
        problem, DesignOptions((Stage(3), Stage(3)), target_objective=enough), start=start
    )
    assert [row.stage for row in found.history] == [0] * (first + 1) + [1]
    assert found.reason == f"T is at most {enough:g}."
    solid, void = problem.length_scale.epsilon
    stages = (Stage(2, constrained=True),)
    free = optimize(problem, DesignOptions(stages), start=start).history[1]
    assert free.g_r > solid or free.g_t > void
    good = 1.001 * free.objective
    bound = optimize(problem, DesignOptions(stages, target_objective=good), start=start)
    assert bound.history[1].objective <= good, "T is good enough"
    assert len(bound.history) > 2, "the constraints are not"


def test_stages_that_are_alike_all_run(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    """And what is reported last is the design returned, also when a stage ends at its start."""
    problem, start = make_problem(short_tube, short_solver), random_density(short_tube, 3)
    result = optimize(problem, DesignOptions((Stage(2),) * 3), start=start)
    assert [row.stage for row in result.history] == [0] * 3 + [1] * 3 + [2] * 3
    assert not any(row.g_r or row.g_t for row in result.history), "no widths are constrained"
    plain = 0 * start + 0.5
    late = optimize(problem, DesignOptions((Stage(2),), seconds=1e-3), start=plain, after=result)
    assert late.history[-1].objective == late.final.objective != result.final.objective


def test_stop_rules(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    problem, start = make_problem(short_tube, short_solver), random_density(short_tube, 3)
    for options, reason in (
        (DesignOptions((Stage(9),), x_tol=0.5), "No variable changes by more than 0.5"),
        (DesignOptions((Stage(9),), kkt_tol=1e3), "The KKT residual is under 1000"),
        (DesignOptions((Stage(9),), seconds=1e-3), "0.001 s have passed"),
    ):
        result = optimize(problem, options, start=start)
        assert reason in result.reason
        assert len(result.history) < 4
    slow = optimize(problem, DesignOptions((Stage(14),), min_relative_decrease=1.0), start=start)
    assert slow.reason == "T fell by less than 1 of it in 10 steps."
    assert slow.history[-1].iteration == 10, "it never falls by all of it"


def test_loop_descends_and_is_reproducible(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    seen = []
    runs = [
        optimize(
            make_problem(short_tube, short_solver),
            DesignOptions((Stage(6),)),
            start=random_density(short_tube, 3),
            callback=lambda row, _: seen.append(row.iteration),
        )
        for _ in range(2)
    ]
    objectives = [row.objective for row in runs[0].history]
    assert objectives[-1] < 0.2 * objectives[0]
    assert objectives == [row.objective for row in runs[1].history]
    assert seen == [*range(7)] * 2
    assert runs[0].reason == "All 6 iterations of the last stage are done."
    assert runs[0].density.min() >= 0
    assert runs[0].density.max() <= 1


def test_a_design_without_equilibrium_is_stepped_back_from(
    short_tube: Skin, short_solver: EquilibriumSolver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Failures of the solver on the way are retried; if they stay, the last design is kept."""
    problem = make_problem(short_tube, short_solver)
    solve, count = short_solver.solve, 0

    def failing(broken: range) -> Any:
        def patched(*args: Any, **kwargs: Any) -> Equilibrium:
            nonlocal count
            count += 1
            result = solve(*args, **kwargs)
            if count in broken:
                raise EquilibriumError("made to fail", result)
            return result

        return patched

    monkeypatch.setattr(short_solver, "solve", failing(range(2, 4)))
    result = optimize(problem, DesignOptions((Stage(3),)), start=random_density(short_tube, 3))
    assert [row.iteration for row in result.history] == [0, 1, 2, 3]
    assert result.history[1].rejected >= 2
    count = 0
    monkeypatch.setattr(short_solver, "solve", failing(range(3, 99)))
    result = optimize(problem, DesignOptions((Stage(3),)), start=random_density(short_tube, 3))
    assert [row.iteration for row in result.history] == [0, 1]
    assert "the last design with one" in result.reason
    assert result.final.objective == result.history[-1].objective


def test_continuation_raises_beta(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    problem = make_problem(short_tube, short_solver)
    stages = [Stage(2, beta=beta) for beta in (2.0, 4.0, 8.0)]
    result = optimize(problem, stages, seed=3)
    # A row for the start of each stage, and one for each step.
    assert [row.beta for row in result.history] == [2, 2, 2, 4, 4, 4, 8, 8, 8]
    assert [row.stage for row in result.history] == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert [row.iteration for row in result.history] == [0, 1, 2, 2, 3, 4, 4, 5, 6]
    assert result.reason == "All 2 iterations of the last stage are done."
    assert problem.fields.beta == 6.0, "the problem is left as it was"


def test_a_soft_start(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    """A fifth, then two fifths of β, within the steps of the first stage that starts from noise."""
    problem = make_problem(short_tube, short_solver)
    result = optimize(problem, [Stage(10), Stage(2)], seed=3)
    ends = [row for row in result.history if row.iteration in (3, 6, 10, 12)]
    betas = {row.stage: row.beta for row in ends}
    assert betas == pytest.approx({0: 1.2, 1: 2.4, 2: 6.0, 3: 6.0})
    assert result.history[-1].iteration == 12
    as_before = DesignOptions((Stage(4),), soft_start=False)
    for hard in (
        optimize(problem, as_before, seed=3),
        optimize(problem, [Stage(4, beta=6.0)], seed=3),
        optimize(problem, [Stage(4)], start=random_density(short_tube, 3)),
        optimize(problem, [Stage(4)], after=result),
    ):
        assert {row.beta for row in hard.history[-5:]} == {6.0}


def test_growth_of_the_miss() -> None:
    """Over the least at the end of an earlier stage as sharp; line families have none."""
    row: Any = Iteration(**dict.fromkeys((f.name for f in fields(Iteration)), 0))  # type: ignore[arg-type]
    rows = [
        replace(row, stage=stage, shape=shape, beta=beta)
        for stage, shape, beta in ((0, 0.1, 4), (1, 9.0, 20), (1, 1.0, 20), (2, 4.0, 20))
    ]
    assert growth_of_miss(rows, 9.0) == 3.0
    assert growth_of_miss(rows[:3], 1.0) == 1.0, "a grey stage before does not count"
    assert growth_of_miss([replace(one, beta=0) for one in rows], 9.0) == 1.0
