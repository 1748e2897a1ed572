"""The summary holds the figures of the print beside those of the design, and changes nothing."""

import copy
import dataclasses

import pytest
from mpi4py import MPI

from toros_fem.design.loop.loop import DesignResult
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.products.tables.steps import Filtering
from toros_fem.results.summary import design_summary, level_figures, shape_problem


def test_levels_have_figures_of_their_own(result: DesignResult) -> None:
    first, *rest = result.history
    history = [first, *(dataclasses.replace(row, level=1) for row in rest)]
    coarse, fine = level_figures(history)
    assert coarse["iterations"] == 0
    assert fine["iterations"] == rest[-1].iteration - rest[0].iteration
    assert coarse["objective_last"] == coarse["objective_first"] == first.objective
    assert fine["objective_last"] == rest[-1].objective
    for name in ("newton_steps", "factorisations", "rejected", "seconds"):
        whole = sum(getattr(row, name) for row in history)
        assert coarse[name] + fine[name] == pytest.approx(whole, rel=1e-12)
    assert len(level_figures(result.history)) == 1


def test_summary_is_equal_on_all_ranks_and_changes_nothing(
    comm: MPI.Comm, result: DesignResult, printed: PrintedDesign
) -> None:
    """Each rank has its own clock, yet all return the first one's."""
    figures, seconds = {"note": [1]}, {"total": float(comm.rank)}
    before = copy.deepcopy((figures, seconds, result.seconds))
    config = Filtering(seed=5)
    summary = design_summary(result, printed, config=config, figures=figures, seconds=seconds)
    assert (figures, seconds, result.seconds) == before
    assert summary == comm.bcast(summary, root=0)
    assert summary["seconds"]["total"] == 0.0
    assert summary["inputs"] == config.as_dict()
    assert summary["note"] == [1]


def test_parts_that_are_left_out_are_none(result: DesignResult, printed: PrintedDesign) -> None:
    problem = shape_problem(result)
    plain = dataclasses.replace(
        result,
        problem=dataclasses.replace(
            problem, length_scale=None, perimeter=None, perimeter_weight=None, metrics=()
        ),
        final=dataclasses.replace(result.final, perimeter=None, length_scale=None),
        history=tuple(dataclasses.replace(row, metrics={}) for row in result.history),
    )
    failed = dataclasses.replace(printed, evaluation=None, failure="made to fail")
    summary = design_summary(plain, failed)
    assert summary["length_scale"] is summary["design"]["perimeter_m"] is None
    assert summary["volume_m3"] is summary["stretch_use"] is None
    assert summary["printed_failure"] == "made to fail"
    assert not any(key.startswith("angle") for key in summary)


def test_infinite_residual_is_none(result: DesignResult, printed: PrintedDesign) -> None:
    """JSON has no infinity."""
    last = dataclasses.replace(result.history[-1], kkt=float("inf"))
    short = dataclasses.replace(result, history=(last,))
    assert design_summary(short, printed)["design"]["kkt_residual"] is None
    finite = dataclasses.replace(result, history=(dataclasses.replace(last, kkt=0.5),))
    assert design_summary(finite, printed)["design"]["kkt_residual"] == pytest.approx(0.5)


def test_figures_are_those_of_the_print(
    comm: MPI.Comm, result: DesignResult, printed: PrintedDesign
) -> None:
    summary = design_summary(result, printed)
    made, last = printed.evaluation, result.history[-1]
    angle = shape_problem(result).metrics_of(made.equilibrium)["angle_deg"]
    assert summary["angle_deg"] == angle != last.metrics["angle_deg"]
    assert summary["angle_target_deg"] == 60.0
    assert summary["design"]["angle_deg"] == last.metrics["angle_deg"]
    assert summary["printed_objective"] == made.shape
    assert summary["volume_m3"] == made.equilibrium.volume
    assert summary["design"]["volume_m3"] == result.final.equilibrium.volume
    assert summary["objective_first"] == result.history[0].objective
    assert summary["objective_last"] == last.objective
    assert summary["iterations"] == last.iteration == 3
    assert summary["newton_steps"] == sum(row.newton_steps for row in result.history)
    assert summary["length_scale"]["g_r"] == last.g_r
    assert summary["manufacture"] == printed.after.summary()
    assert summary["dropped"]["islands"] == len(printed.cleaned.dropped)
    assert summary["ranks"] == comm.size
    assert summary["linear_solver"].startswith("CHOLMOD on ")
    assert summary["parts_by_symmetry"] == 1
