"""A loop that is stopped and goes on is the same, to the last bit, as one that is not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.designs import full, make_problem
from helpers.loops import OneEntry, Stopped, figures
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem.base.errors import CheckpointError, NoEquilibriumError
from toros_fem.base.files import Archive
from toros_fem.design.loop.journal import kept_evaluation, restored_evaluation, signature_of
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.design.loop.steps import Steps, Variables
from toros_fem.design.relaxed.problem import FixedDirections, relaxed_problem
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.meshes import Skin, cylinder, sew

OPTIONS = DesignOptions((Stage(2), Stage(1, constrained=True)))


def densities(tube: Skin, curvature: str = "average") -> DesignProblem:
    """With all that a problem has; nothing is shared with an earlier one but the mesh."""
    composite = Composite(bending=Bending(curvature=curvature))
    return full(tube, solver_on_base(tube, composite), beta=20.0)


def families(tube: Skin) -> DesignProblem:
    design = densities(tube)
    return relaxed_problem(design, FixedDirections(4, 0.3), 8e-3)  # type: ignore[arg-type]


def stopped(make: Callable[[], DesignProblem], options: DesignOptions, rows: int) -> Archive:
    journal = OneEntry(stop_at=rows)
    with pytest.raises(Stopped):
        optimize(make(), options, seed=3, journal=journal)
    return journal.kept


def check(make: Callable[[], DesignProblem], options: DesignOptions, *rows: int) -> None:
    whole = optimize(make(), options, seed=3)
    for count in rows:
        journal = OneEntry(saved=stopped(make, options, count))
        again = optimize(make(), options, seed=3, journal=journal)
        assert journal.rows == len(whole.history) - count, "only what is left is done"
        assert [figures(r) for r in again.history] == [figures(r) for r in whole.history]
        assert np.array_equal(again.density, whole.density)
        assert np.array_equal(again.final.equilibrium.state, whole.final.equilibrium.state)
        slopes = [found.final.problem.differentiate(found.final) for found in (again, whole)]
        assert np.array_equal(slopes[0].gradient, slopes[1].gradient)
        assert again.reason == whole.reason
        assert again.pressures == whole.pressures


@pytest.mark.slow
def test_densities_go_on_bit_for_bit(short_tube: Skin) -> None:
    """Inside a stage, at the start of one, and after the last row; turns of edges are kept."""
    check(lambda: densities(short_tube, "midedge"), OPTIONS, 2, 4, 5)


@pytest.mark.slow
def test_a_design_without_constraints_and_residuals_goes_on(short_tube: Skin) -> None:
    """MMA then has no multipliers, which is another thing than none yet."""

    def plain() -> DesignProblem:
        return make_problem(short_tube, solver_on_base(short_tube, Composite(bending=None)))

    check(plain, DesignOptions((Stage(3),)), 2, 3)
    state = stopped(plain, DesignOptions((Stage(2),)), 2)
    problem = plain()
    evaluation = restored_evaluation(problem, state)
    slopes, options = problem.differentiate(evaluation), DesignOptions()
    steps = Steps(problem, Variables(problem, options), Stage(2), options, evaluation, slopes)
    steps.restore(state)
    steps.mma.rescale(2.0)
    assert isinstance(steps.mma.state.multipliers, np.ndarray)


@pytest.mark.slow
def test_line_families_go_on_bit_for_bit(short_tube: Skin) -> None:
    check(lambda: families(short_tube), DesignOptions((Stage(2),)), 2)


@pytest.mark.slow
def test_another_number_of_ranks_goes_on(comm: MPI.Comm, tube: Skin) -> None:
    """What all ranks wrote, one alone goes on with, to the solver's tolerance; and vice versa."""
    if comm.size == 1:
        pytest.skip("needs two ranks to compare with one")
    options = DesignOptions((Stage(2, constrained=True),))
    alone = sew(MPI.COMM_SELF, cylinder(MPI.COMM_SELF, 0.06, 0.02, 4.5e-3))
    whole = optimize(densities(tube), options, seed=3)
    together = stopped(lambda: densities(tube), options, 2)
    by_one = stopped(lambda: densities(alone), options, 2)
    again = optimize(densities(alone), options, seed=3, journal=OneEntry(saved=together))
    back = optimize(densities(tube), options, seed=3, journal=OneEntry(saved=by_one))
    assert again.final.objective == pytest.approx(whole.final.objective, rel=1e-4)
    assert back.final.objective == pytest.approx(whole.final.objective, rel=1e-4)
    every = tube.gather_cells(whole.density)
    assert np.abs(alone.gather_cells(again.density) - every).max() < 1e-3
    assert np.abs(tube.gather_cells(back.density) - every).max() < 1e-3


def test_what_does_not_fit_is_told(short_tube: Skin) -> None:
    problem, options = densities(short_tube), DesignOptions((Stage(1),))
    saved = stopped(lambda: problem, options, 1)
    for arrays, numbers in (
        ({**saved.arrays, "unknowns": saved.arrays["unknowns"][:-1]}, saved.numbers),
        ({**saved.arrays, "x": saved.arrays["x"][:-7]}, saved.numbers),
        (saved.arrays, {**saved.numbers, "history": [{"iteration": 0}]}),
        (saved.arrays, {k: v for k, v in saved.numbers.items() if k != "mma"}),
        ({k: v for k, v in saved.arrays.items() if k != "density"}, saved.numbers),
    ):
        journal = OneEntry(saved=Archive("checkpoint", arrays, numbers))
        with pytest.raises(CheckpointError, match="does not fit"):
            optimize(problem, options, seed=3, journal=journal)


def test_a_signature_tells_problems_apart(alone: MPI.Comm, short_tube: Skin) -> None:
    one = densities(short_tube)
    shorter = densities(sew(alone, cylinder(alone, 0.05, 0.02, 4.5e-3)))
    assert signature_of(one, OPTIONS) == signature_of(densities(short_tube), OPTIONS)
    others = {signature_of(one), signature_of(shorter, OPTIONS), signature_of(one, Stage(1))}
    assert len(others | {signature_of(one, OPTIONS)}) == 4


def test_a_simulation_without_equilibrium_is_not_tried_again(short_tube: Skin) -> None:
    """What failed is kept as a file keeps it, and told again in the same words."""
    problem, tried = densities(short_tube), []

    def simulate() -> Evaluation:
        tried.append(1)
        raise NoEquilibriumError("it is too weak.")

    journal = OneEntry(stop_at=1)
    with pytest.raises(Stopped):
        kept_evaluation(journal, problem, simulate)
    with pytest.raises(NoEquilibriumError, match="it is too weak"):
        kept_evaluation(journal, problem, simulate)
    assert len(tried) == 1
    older = OneEntry(stop_at=1, saved=replace(journal.kept, written_by="0.0.1"))
    with pytest.raises(Stopped):
        kept_evaluation(older, problem, simulate)
    assert len(tried) == 2, "another version tries again"
