"""The best of several random starts, whatever the number of ranks."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.designs import make_problem
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem import errors
from toros_fem.design.loop.levels import best_start, optimize_levels
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.meshes import cylinder, sew

OPTIONS = DesignOptions((Stage(3),))


def tube(comm: MPI.Comm, edge: float = 4.5e-3) -> ShapeProblem:
    skin = sew(comm, cylinder(comm, 0.06, 0.02, edge))
    return make_problem(skin, solver_on_base(skin))


def test_the_best_of_three(comm: MPI.Comm) -> None:
    """It equals that of each start alone, and all ranks know it."""
    seeds = [4, 1, 7]
    found = best_start(comm, tube, OPTIONS, seeds)
    problem = tube(MPI.COMM_SELF)
    alone = {s: optimize(problem, OPTIONS, seed=s).final.objective for s in seeds}
    assert found.objectives == pytest.approx(alone, rel=1e-9)
    assert found.seed == min(alone, key=lambda s: alone[s])
    design = found.design
    assert design.history[-1].objective == found.objectives[found.seed]
    for theirs in comm.allgather((found.seed, found.objectives, design.density)):
        assert theirs[:2] == (found.seed, found.objectives)
        np.testing.assert_array_equal(theirs[2], design.density)


def test_it_goes_on_on_a_finer_mesh(alone: MPI.Comm) -> None:
    found = best_start(alone, tube, OPTIONS, [1, 2])
    fine = DesignOptions((Stage(2),), pressure_move=0.02)
    result = optimize_levels([tube(alone, 3.5e-3)], [fine], after=found.design)
    assert [row.level for row in result.history] == [0] * 4 + [1] * 3
    assert [row.iteration for row in result.history] == [0, 1, 2, 3, 3, 4, 5]
    assert result.history[4].objective < 0.5 * result.history[0].objective
    assert result.pressures == found.design.pressures


def test_on_the_same_mesh_the_density_stays(alone: MPI.Comm) -> None:
    """ρ goes on there, not ρ̄: a second filter would change the design."""
    found = best_start(alone, tube, OPTIONS, [1])
    problem = tube(alone)
    density, state = found.design.on(problem)
    evaluation = problem.simulate(density, state, found.design.pressures)
    assert evaluation.objective == pytest.approx(found.objectives[1], rel=1e-6)


def test_starts_without_an_equilibrium(alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are left out; without any the error is that of a start."""
    refused = {1}

    def some(problem: ShapeProblem, options: DesignOptions, seed: int, **_: object) -> object:
        if seed in refused:
            raise errors.NoEquilibriumError(f"no equilibrium for seed {seed}")
        return optimize(problem, options, seed=seed)

    monkeypatch.setattr("toros_fem.design.loop.levels.optimize", some)
    found = best_start(alone, tube, OPTIONS, [1, 2, 3])
    assert found.objectives[1] == np.inf
    assert found.seed in (2, 3)
    refused |= {2, 3}
    with pytest.raises(errors.NoEquilibriumError, match="no equilibrium for seed"):
        best_start(alone, tube, OPTIONS, [1, 2, 3])


def test_kept_widths_count_more_than_the_objective(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the last stage constrains them; else the lower T is better."""
    problem: Any = SimpleNamespace(length_scale=SimpleNamespace(epsilon=np.full(2, 0.1)))

    def made(_: object, __: DesignOptions, seed: int, **___: object) -> SimpleNamespace:
        final = SimpleNamespace(objective=1 / seed, length_scale=np.array([0.0, 0.07 * seed]))
        return SimpleNamespace(problem=problem, final=final)

    monkeypatch.setattr("toros_fem.design.loop.levels.optimize", made)
    monkeypatch.setattr("toros_fem.design.loop.levels.gathered", lambda result: result)
    for constrained, seed in ((True, 1), (False, 2)):
        options = DesignOptions((Stage(3, constrained=constrained),))
        assert best_start(alone, lambda _: problem, options, [1, 2]).seed == seed


def test_an_error_on_one_rank_is_raised_on_all(comm: MPI.Comm) -> None:
    def broken(alone: MPI.Comm) -> ShapeProblem:
        if comm.rank == comm.size - 1:
            raise errors.ParameterError("one rank alone")
        return tube(alone)

    with pytest.raises(errors.ParameterError, match="one rank alone"):
        best_start(comm, broken, OPTIONS, [1, 2])
