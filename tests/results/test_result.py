"""The summary holds the figures of the print beside those of the design, and changes nothing."""

import copy
import dataclasses
from pathlib import Path
from typing import Any

import pytest
import shapely
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.miss import shape_of
from toros_fem.making.as_printed import PrintedDesign
from toros_fem.making.printability import PanelRegion
from toros_fem.measures.figures import Figure, Tolerances
from toros_fem.products.common.tables import FilterTable
from toros_fem.results.result import PrintedResult, level_figures, shape_problem, write_summary
from toros_fem.results.runs.stored_run import summary_of


def of(result: DesignResult, printed: PrintedDesign, **more: Any) -> PrintedResult:
    """The result of a design and its print (collective)."""
    return PrintedResult(result, printed, printed.metrics, **more)


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
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    """Each rank has its own clock, yet all return the first one's."""
    seconds = {"total": float(comm.rank)}
    before = copy.deepcopy((seconds, result.seconds))
    config, folder = FilterTable(seed=5), shared(comm, tmp_path)
    summary = write_summary(comm, folder, of(result, printed, config=config, seconds=seconds))
    assert (seconds, result.seconds) == before
    assert summary == comm.bcast(summary, root=0)
    assert summary["seconds"]["total"] == 0.0
    assert (summary["inputs"], summary["ranks"]) == (config.as_dict(), comm.size)
    comm.barrier()
    assert summary_of(folder).value("angle_deg") == summary["figures"][0]["value"]


def test_parts_that_are_left_out_are_none(result: DesignResult, printed: PrintedDesign) -> None:
    problem = shape_problem(result)
    plain = dataclasses.replace(
        result,
        problem=problem.changed(length_scale=None, terms=(), metrics=()),
        final=dataclasses.replace(result.final, measures={}, length_scale=None),
        history=tuple(dataclasses.replace(row, metrics={}) for row in result.history),
    )
    failed = dataclasses.replace(printed, evaluation=None, failure="made to fail")
    found = of(plain, failed)
    summary = found.summary()
    assert summary["length_scale"] is summary["design"]["perimeter_m"] is None
    assert found.value("volume_m3") is found.value("stretch_use") is None
    assert summary["printed_failure"] == "made to fail"
    assert found.metric_figures == ()


def test_infinite_residual_is_none(result: DesignResult, printed: PrintedDesign) -> None:
    """JSON has no infinity."""
    last = dataclasses.replace(result.history[-1], kkt=float("inf"))
    short = dataclasses.replace(result, history=(last,))
    assert of(short, printed).summary()["design"]["kkt_residual"] is None
    finite = dataclasses.replace(result, history=(dataclasses.replace(last, kkt=0.5),))
    assert of(finite, printed).summary()["design"]["kkt_residual"] == pytest.approx(0.5)


def test_figures_are_those_of_the_print(
    comm: MPI.Comm, result: DesignResult, printed: PrintedDesign
) -> None:
    found = dataclasses.replace(of(result, printed), intervals={"angle_deg": 1.5})
    summary, made, last = found.summary(), printed.evaluation, result.history[-1]
    assert made is not None
    angle = shape_problem(result).metrics_of(made.equilibrium)["angle_deg"]
    assert angle != last.metrics["angle_deg"] == summary["design"]["angle_deg"]
    assert found.figures[0] == Figure("angle", "deg", angle, 1.5, 60.0, 3.0)
    assert summary["printed_objective"] == made.shape
    assert found.value("volume_m3") == made.equilibrium.volume
    assert summary["design"]["volume_m3"] == result.final.equilibrium.volume
    assert summary["objective_first"] == result.history[0].objective
    assert summary["objective_last"] == last.objective
    assert summary["iterations"] == last.iteration == 3
    assert summary["newton_steps"] == sum(row.newton_steps for row in result.history)
    assert summary["length_scale"]["g_r"] == last.g_r
    assert summary["manufacture"] == printed.after.summary()
    assert summary["dropped"]["islands"] == len(printed.cleaned.dropped)
    assert summary["linear_solver"].startswith("CHOLMOD on ")
    assert summary["parts_by_symmetry"] == 1
    designed = f"({last.metrics['angle_deg']:.3g}° as designed)"
    assert f". angle {angle:.1f} ± 1.5° of 60° {designed}" in found.sentence()
    assert "as printed at " in found.sentence()


def test_a_miss_is_said(result: DesignResult, printed: PrintedDesign) -> None:
    """In the last line and the summary: by how much, and what binds."""
    shape = shape_of(printed.evaluation)
    assert shape["shape_distance_percent"] > 3
    assert {
        "tip_distance_mm",
        "tip_direction_out_of_plane_deg",
        "largest_distance_mm",
    } < shape.keys()
    widths = {"angle_deg": 0.1, **dict.fromkeys(shape, 0.01)}
    found = dataclasses.replace(of(result, printed), intervals=widths, shape=shape)
    figures = {figure.key: figure for figure in found.figures}
    assert figures["shape_distance_percent"].state == figures["angle_deg"].state == "missed"
    assert figures["tip_direction_deg"].interval == 0.01
    summary, said = found.summary()["verdict"], found.sentence()
    assert summary["state"] == "missed"
    assert said.startswith(f"{summary['words']}. What binds: ")
    assert figures["angle_deg"].why in said
    assert figures["shape_distance_percent"].why in said
    assert "tip direction" in said
    assert not any("iterations" in text for text in summary["binding"])
    for text in summary["binding"]:
        assert text in said
    lax = Tolerances(figure=2.0, shape=2.0, direction=170.0)
    good = dataclasses.replace(found, tolerances=lax)
    assert good.summary()["verdict"] == {"state": "reached", "words": "Reached", "binding": []}
    assert good.sentence().startswith("Reached. angle ")
    unknown = dataclasses.replace(good, intervals={})
    assert unknown.summary()["verdict"]["binding"][-1] == "error by the mesh: it is not estimated"
    assert unknown.sentence().startswith("Not certain: ")


def test_what_binds(result: DesignResult, printed: PrintedDesign) -> None:
    """Pressure at its bound, used-up stretch bounds, and what cleaning changed."""
    found, made = of(result, printed), printed.evaluation
    assert made is not None
    pressure = made.equilibrium.pressure
    free, tight = (
        dataclasses.replace(
            result,
            problem=shape_problem(result).changed(
                physics=dataclasses.replace(shape_problem(result).physics, pressure_bounds=bounds)
            ),
        )
        for bounds in ((0.5 * pressure, 2 * pressure), (0.5 * pressure, pressure))
    )
    at_bound = (
        f"pressure at its bound, {pressure / 1e3:g} kPa. If the pump gives more: "
        f'pressure_bounds up to "{1.5 * pressure / 1e3:.3g} kPa"'
    )
    assert at_bound not in dataclasses.replace(found, design=free).binding
    assert at_bound in dataclasses.replace(found, design=tight).binding
    stretched = dataclasses.replace(made.equilibrium, stretch_use=0.98)
    full = dataclasses.replace(printed, evaluation=dataclasses.replace(made, equilibrium=stretched))
    assert "98% of the stretch bounds are used" in dataclasses.replace(found, printed=full).binding
    hole = PanelRegion(0, shapely.box(0.0, 0.0, 1e-3, 1e-3))
    joined: Any = (hole,)
    cut = dataclasses.replace(printed.cleaned, filled=(hole, hole), bridged=joined)
    filled = dataclasses.replace(printed, cleaned=cut)
    told = dataclasses.replace(found, printed=filled).binding
    assert any("1 island joined, 2 holes filled" in text for text in told)
