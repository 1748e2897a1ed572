"""Results are written whole, with or without a reporter, or refused alike on all ranks."""

import copy
import csv
import dataclasses
import json
import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import numpy as np
import pytest
from helpers.designs import full
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.design.config import DesignConfig
from toros_fem.design.loop import DesignResult, optimize
from toros_fem.design.options import Stage
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.errors import OutputError, ParameterError
from toros_fem.fabrication.as_printed import PrintedDesign, as_printed
from toros_fem.meshes import Skin, bend
from toros_fem.objectives.metrics import Metric, bend_angle
from toros_fem.output.writer import write_results

ANGLE = Metric("angle", "deg", 60.0, lambda of, x: float(np.degrees(bend_angle(of, x))))


@pytest.fixture(scope="module")
def result(tube: Skin, tube_solver: EquilibriumSolver) -> DesignResult:
    problem = full(tube, tube_solver, beta=20.0)
    target = bend(np.radians(60), 0.06, neutral=0.01)(tube.pattern.points)
    problem = dataclasses.replace(problem, metrics=(ANGLE,), target=target)
    return optimize(problem, [Stage(2), Stage(1, constrained=True)], seed=3)


@pytest.fixture(scope="module")
def printed(result: DesignResult) -> PrintedDesign:
    return as_printed(result.problem, result, island_area=np.inf)


def test_everything_is_written_without_a_reporter(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    folder = shared(comm, tmp_path) / "new" / "folder"
    config = DesignConfig(seed=3)
    summary = write_results(str(folder), result, printed, config=config, figures={"note": 1})
    comm.barrier()
    assert {path.name for path in folder.iterdir()} == {
        "summary.json", "history.csv", "pattern.svg", "skin.vtu", "pattern.png", "manufacture.png",
        "shape.png", "convergence.png",
    }  # fmt: skip
    assert json.loads((folder / "summary.json").read_text(encoding="utf-8")) == summary
    assert summary["inputs"] == config.as_dict()
    assert summary["note"] == 1
    with (folder / "history.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["iteration"]) for row in rows] == [0, 1, 2, 2, 3]
    assert [float(row["angle_deg"]) for row in rows] == [
        row.metrics["angle_deg"] for row in result.history
    ]
    mesh = meshio.read(folder / "skin.vtu")
    assert set(mesh.cell_data["printed"][0]) == {0.0, 1.0}
    assert set(mesh.cell_data) == {"panel", "rho", "rho_filtered", "rho_projected", "printed"}
    groups = ET.parse(folder / "pattern.svg").getroot().findall("{http://www.w3.org/2000/svg}g")
    assert {group.get("id") for group in groups} == {"wall", "base", "tip"}


def test_what_is_given_stays_unchanged(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    figures, seconds = {"note": [1]}, {"total": 2.5}
    before = copy.deepcopy((figures, seconds, result.seconds, result.final.seconds))
    folder = shared(comm, tmp_path)
    summary = write_results(folder, result, printed, figures=figures, seconds=seconds)
    assert (figures, seconds, result.seconds, result.final.seconds) == before
    assert summary["seconds"] == {**comm.bcast(result.seconds, root=0), "total": 2.5}
    assert summary["inputs"] is None


def test_print_without_equilibrium(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    """The fields show the design, and no figure of it passes for one of the print."""
    folder = shared(comm, tmp_path)
    failed = dataclasses.replace(printed, evaluation=None, failure="made to fail")
    summary = write_results(folder, result, failed)
    comm.barrier()
    assert summary["angle_deg"] is summary["volume_m3"] is summary["printed_objective"] is None
    assert summary["printed_failure"] == "made to fail"
    assert summary["design"]["angle_deg"] == result.history[-1].metrics["angle_deg"]
    mesh = meshio.read(folder / "skin.vtu")
    designed = result.problem.skin.gather_vertices(result.final.equilibrium.positions)
    assert mesh.points == pytest.approx(designed)


def test_folder_that_cannot_be_written(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    """Only the first rank writes, yet all ranks raise."""
    taken = shared(comm, tmp_path) / "taken"
    if comm.rank == 0:
        taken.write_text("a file, not a folder", encoding="utf-8")
    comm.barrier()
    with pytest.raises(OutputError, match=r"taken could not be written.*Choose another folder"):
        write_results(taken, result, printed)
    comm.barrier()
    assert taken.is_file()


def test_only_shapes_have_these_files(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    other = dataclasses.replace(result, problem=object())  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="that of a object"):
        write_results(shared(comm, tmp_path), other, printed)
