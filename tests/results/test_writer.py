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
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.errors import OutputError, ParameterError
from toros_fem.base.files import write_together
from toros_fem.design.loop.config import DesignConfig
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.making.print.contours import panel_outline
from toros_fem.materials.sheet import Composite, Membrane
from toros_fem.measures.metrics import Metric, swelling
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.readings.wrinkles import wrinkle_field, wrinkles
from toros_fem.mechanics.skin.supports import clamp, symmetry_plane
from toros_fem.meshes import Skin, cylinder, mirrored, sew
from toros_fem.results.writer import (
    if_plotting,
    write_comparison,
    write_pictures,
    write_pressure_path,
    write_results,
)


def test_everything_is_written_without_a_reporter(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    folder = shared(comm, tmp_path) / "new" / "folder"
    config = DesignConfig(seed=3)
    summary = write_results(str(folder), result, printed, config=config, figures={"note": 1})
    comm.barrier()
    assert {path.name for path in folder.iterdir()} == {
        "summary.json", "history.csv", "pattern.svg", "skin.vtu", "pattern.png", "manufacture.png",
        "shape.png", "convergence.png", "design.png", "pattern.npz", "print.npz", "frames",
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


def test_a_tension_field_has_its_wrinkles_written(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    """State and tension of each triangle, of the shape that is shown, and their picture."""
    folder, problem = shared(comm, tmp_path), result.problem
    assert isinstance(problem, ShapeProblem)
    skin, shown = problem.skin, printed.evaluation or result.final
    composite = Composite(membrane=Membrane("tension-field"))
    solver = EquilibriumSolver(skin, composite, problem.solver.model.supports)
    relaxed = dataclasses.replace(result, problem=dataclasses.replace(problem, solver=solver))
    write_results(folder, relaxed, printed)
    comm.barrier()
    assert (folder / "wrinkles.png").is_file()
    data = meshio.read(folder / "skin.vtu").cell_data
    positions = skin.gather_vertices(shown.equilibrium.positions)
    density = skin.gather_cells(shown.projected)
    field = wrinkles(skin.pattern, composite, density, positions)
    assert len(set(field.state)) > 1
    assert np.array_equal(data["wrinkling"][0], field.state)
    assert data["tension"][0] == pytest.approx(field.direction, abs=1e-12)


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


def test_pressure_path(comm: MPI.Comm, tmp_path: Path, tube_solver: EquilibriumSolver) -> None:
    skin = tube_solver.skin
    density = np.zeros(len(skin.pattern.triangles))
    radius = Metric("radius", "percent", 100.0, lambda of, x: 100 * swelling(of, x))
    points = list(trace(tube_solver, density[skin.owned_cells], [0.0, 500.0, 1e3], [radius]))
    folder, figures = shared(comm, tmp_path) / "path", {"note": 1}
    summary = write_pressure_path(
        comm, folder, skin.pattern, points, density, [radius], figures=figures
    )
    comm.barrier()
    assert figures == {"note": 1}
    assert summary == json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["note"] == 1
    assert (summary["triangles"], summary["parts_by_symmetry"]) == (len(density), 1)
    assert summary["newton_steps"] == sum(point.result.steps for point in points)
    with (folder / "curve.csv").open(encoding="utf-8") as file:
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    assert [row["pressure_pa"] for row in rows] == [0.0, 500.0, 1e3]
    assert rows[2]["radius_percent"] == points[2].metrics["radius_percent"] > 100
    assert meshio.read(folder / "skin.vtu").points == pytest.approx(points[2].positions)
    for name in ("curve.png", "shapes.png"):
        assert (folder / name).stat().st_size > 5000


def test_pressure_path_of_a_tension_field_shows_its_wrinkles(
    comm: MPI.Comm, tmp_path: Path
) -> None:
    tube = cylinder(comm, 0.04, 0.02, 6e-3)
    composite = Composite(bending=None, membrane=Membrane("tension-field"))
    solver = EquilibriumSolver(sew(comm, tube), composite, clamp(tube, ["base", "tip"]))
    density = np.zeros(len(tube.panel))
    wide = Metric("radius", "ratio", 1.0, swelling)
    points = list(trace(solver, density[solver.skin.owned_cells], [2e3], [wide]))
    folder = shared(comm, tmp_path)
    write_pressure_path(comm, folder, tube, points, density, [wide], composite=composite)
    comm.barrier()
    folds = wrinkle_field(solver, density[solver.skin.owned_cells], points[0].result)
    fields = meshio.read(folder / "skin.vtu").cell_data
    assert np.array_equal(fields["wrinkling"][0], folds.state)
    assert fields["tension"][0] == pytest.approx(folds.direction)
    assert (folder / "wrinkles.png").stat().st_size > 5000


def test_pressure_path_of_half_a_tube_shows_the_whole(comm: MPI.Comm, tmp_path: Path) -> None:
    half = cylinder(comm, 0.04, 0.02, 6e-3, planes=(1,))
    images, skin = mirrored(half, (1,)), sew(comm, half)
    supports = clamp(half, ["base"]) | symmetry_plane(half, 1)
    solver = EquilibriumSolver(skin, Composite(bending=None), supports)
    density: np.ndarray = np.arange(len(half.panel)) / len(half.panel)
    wide = Metric("radius", "ratio", 1.0, swelling).of_whole((1,))
    points = list(trace(solver, density[skin.owned_cells], [0.0, 500.0], [wide]))
    folder = shared(comm, tmp_path)
    summary = write_pressure_path(comm, folder, half, points, density, [wide], whole=images)
    comm.barrier()
    assert (summary["triangles"], summary["parts_by_symmetry"]) == (len(half.panel), 2)
    mesh = meshio.read(folder / "skin.vtu")
    assert mesh.points == pytest.approx(images.at_vertices(points[1].positions))
    assert mesh.cell_data["density"][0] == pytest.approx(images.at_cells(density))
    assert np.array_equal(mesh.cells_dict["triangle"], images.pattern.triangles)
    with (folder / "curve.csv").open(encoding="utf-8") as file:
        volumes = [float(row["volume_m3"]) for row in csv.DictReader(file)]
    a, b, c = np.moveaxis(mesh.points[images.pattern.triangles], 1, 0)
    assert volumes[1] == pytest.approx(np.einsum("ij,ij->", a, np.cross(b, c)) / 6, rel=1e-6)
    assert volumes == pytest.approx([2 * p.result.volume for p in points])


def test_comparison(comm: MPI.Comm, tmp_path: Path, tube: Skin) -> None:
    folder = shared(comm, tmp_path)
    wall = panel_outline(tube.pattern, tube.pattern.panel_index("wall"))
    variants = [("one", wall, "a caption"), ("other", wall.buffer(-5e-3), "another")]
    write_comparison(comm, folder, "table", {"rows": [1, 2]}, tube.pattern, "wall", variants)
    comm.barrier()
    assert json.loads((folder / "table.json").read_text(encoding="utf-8")) == {"rows": [1, 2]}
    assert (folder / "table.png").stat().st_size > 5000


def test_pictures_are_drawn_on_the_first_rank(comm: MPI.Comm, tmp_path: Path) -> None:
    folder, drawn = shared(comm, tmp_path), []

    def draw(path: Path) -> None:
        drawn.append(path.name)
        path.write_text(path.name, encoding="utf-8")

    write_pictures(comm, folder / "new", {"a.png": draw, "b.png": draw})
    comm.barrier()
    assert drawn == (["a.png", "b.png"] if comm.rank == 0 else [])
    assert (folder / "new" / "b.png").read_text(encoding="utf-8") == "b.png"


def test_no_pictures_without_matplotlib(capsys: pytest.CaptureFixture[str]) -> None:
    def draw() -> None:
        raise ImportError("No module named 'matplotlib'")

    if_plotting(draw)
    assert "no pictures: No module named 'matplotlib'" in capsys.readouterr().err


def test_all_ranks_raise_what_one_meets(comm: MPI.Comm, tmp_path: Path) -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left on device"):
        write_together(comm, shared(comm, tmp_path), full)
