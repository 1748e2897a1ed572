"""Results are written whole, with or without a reporter, or refused alike on all ranks."""

import csv
import dataclasses
from pathlib import Path

import meshio
import numpy as np
import pytest
from helpers.blank_pictures import blank_pictures
from helpers.scenes import shared, square
from mpi4py import MPI

from toros_fem.base.errors import OutputError, ParameterError
from toros_fem.base.files import guarded, if_plotting
from toros_fem.base.packages import versions
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.making.as_printed import PrintedDesign
from toros_fem.materials.sheet import Composite, Membrane
from toros_fem.measures.metrics import Metric, swelling
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.readings.wrinkles import wrinkle_field, wrinkles
from toros_fem.mechanics.skin.supports import clamp, symmetry_plane
from toros_fem.meshes import cylinder, mirrored, sew
from toros_fem.results.pictures.style import page
from toros_fem.results.runs.frames import read_frames
from toros_fem.results.writer import PathResult, write_fields, write_pressure_path, write_results


def test_a_tension_field_has_its_wrinkles_written(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    """State and tension of each triangle, of the shape that is shown, and their picture."""
    folder, problem = shared(comm, tmp_path), result.problem
    assert isinstance(problem, ShapeProblem)
    skin, shown = problem.skin, printed.evaluation or result.final
    composite = Composite(membrane=Membrane("tension-field"))
    solver = EquilibriumSolver(skin, composite, problem.solver.model.supports)
    physics = dataclasses.replace(problem.physics, solver=solver)
    other = problem.changed(physics=physics)
    relaxed = dataclasses.replace(result, problem=other)
    of_print = dataclasses.replace(printed, evaluation=dataclasses.replace(shown, problem=other))
    with blank_pictures():
        write_results(folder, relaxed, of_print)
    comm.barrier()
    assert (folder / "wrinkles.png").is_file()
    assert (folder / "pattern.png").is_file()
    (frame,) = read_frames(folder / "frames", "print")
    assert frame.density is None, "the print itself is shown"
    data = meshio.read(folder / "skin.vtu").cell_data
    positions = skin.gather_vertices(shown.equilibrium.positions)
    density = skin.gather_cells(shown.projected)
    field = wrinkles(skin.pattern, composite, density, positions)
    assert len(set(field.state)) > 1
    assert np.array_equal(data["wrinkling"][0], field.state)
    assert data["tension"][0] == pytest.approx(field.direction, abs=1e-12)


def test_print_without_equilibrium(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    """The fields show the design, and no figure of it passes for one of the print."""
    folder = shared(comm, tmp_path)
    failed = dataclasses.replace(printed, evaluation=None, failure="made to fail")
    with blank_pictures():
        summary = write_results(folder, result, failed)
    comm.barrier()
    assert {row["value"] for row in summary["figures"] if row["name"] != "pressure"} == {None}
    assert summary["printed_objective"] is None
    assert summary["printed_failure"] == "made to fail"
    assert summary["design"]["angle_deg"] == result.history[-1].metrics["angle_deg"]
    mesh = meshio.read(folder / "skin.vtu")
    designed = result.problem.skin.gather_vertices(result.final.equilibrium.positions)
    assert mesh.points == pytest.approx(designed)
    (frame,) = read_frames(folder / "frames", "print")
    assert frame.density == pytest.approx(mesh.cell_data["rho_projected"][0], abs=4e-3)


def test_a_run_that_looks_finished_has_all_its_files(
    comm: MPI.Comm,
    tmp_path: Path,
    result: DesignResult,
    printed: PrintedDesign,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its summary comes last."""

    def full(*_: object) -> None:
        raise OSError("no space")

    folder = shared(comm, tmp_path)
    monkeypatch.setattr("toros_fem.results.writer.write_fields", full)
    with pytest.raises(OutputError, match="no space"):
        write_results(folder, result, printed)
    comm.barrier()
    assert (folder / "print.npz").exists()
    assert not (folder / "summary.json").exists()


def test_only_shapes_have_these_files(
    comm: MPI.Comm, tmp_path: Path, result: DesignResult, printed: PrintedDesign
) -> None:
    other = dataclasses.replace(result, problem=object())  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="that of a object"):
        write_results(shared(comm, tmp_path), other, printed)


def test_pressure_path_of_half_a_tube_shows_the_whole(alone: MPI.Comm, tmp_path: Path) -> None:
    half = cylinder(alone, 0.04, 0.02, 6e-3, planes=(1,))
    images, skin = mirrored(half, (1,)), sew(alone, half)
    supports = clamp(half, ["base"]) | symmetry_plane(half, 1)
    composite = Composite(bending=None, membrane=Membrane("tension-field"))
    solver = EquilibriumSolver(skin, composite, supports)
    density: np.ndarray = np.arange(len(half.panel)) / len(half.panel)
    wide = Metric("radius", "ratio", 1.0, swelling).of_whole((1,))
    points = list(trace(solver, density[skin.owned_cells], [0.0, 500.0], [wide]))
    folder = tmp_path
    found = PathResult(half, points, density, [wide], images, composite)
    write_pressure_path(alone, folder, found)
    assert found.whole.parts == 2
    mesh = meshio.read(folder / "skin.vtu")
    assert mesh.points == pytest.approx(images.at_vertices(points[1].positions))
    assert mesh.cell_data["density"][0] == pytest.approx(images.at_cells(density))
    assert np.array_equal(mesh.cells_dict["triangle"], images.pattern.triangles)
    folds = wrinkle_field(solver, density[skin.owned_cells], points[1].result)
    assert np.array_equal(
        mesh.cell_data["wrinkling"][0], images.at_cells(folds.state.astype(float))
    )
    assert (folder / "wrinkles.png").stat().st_size > 5000
    for frame in read_frames(folder / "frames", "pressure"):
        assert frame.density == pytest.approx(images.at_cells(density), abs=1e-6)
    with (folder / "curve.csv").open(encoding="utf-8") as file:
        volumes = [float(row["volume_m3"]) for row in csv.DictReader(file)]
    a, b, c = np.moveaxis(mesh.points[images.pattern.triangles], 1, 0)
    assert volumes[1] == pytest.approx(np.einsum("ij,ij->", a, np.cross(b, c)) / 6, rel=1e-6)
    assert volumes == pytest.approx([2 * p.result.volume for p in points])
    with pytest.MonkeyPatch.context() as patch:  # of a skin that is no part, without pictures
        patch.setattr("toros_fem.results.writer.if_plotting", lambda draw: None)
        plain = PathResult(half, points, density, [wide], mirrored(half, ()))
        write_pressure_path(alone, folder / "new", plain)
    assert (plain.entries()["triangles"], plain.whole.parts) == (len(half.panel), 1)
    assert plain.entries()["newton_steps"] == sum(point.result.steps for point in points)
    assert meshio.read(folder / "new" / "skin.vtu").points == pytest.approx(points[1].positions)


def test_all_ranks_raise_what_one_meets(comm: MPI.Comm, tmp_path: Path) -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left on device"):
        guarded(comm, shared(comm, tmp_path), full)


def test_fields(tmp_path: Path) -> None:
    pattern = square(n=2)
    positions = pattern.points * [1, 2, 1] + [0, 0, 0.5]
    density = np.linspace(0, 1, len(pattern.triangles)).astype(np.float64)
    write_fields(tmp_path / "skin.vtu", pattern, positions, {"density": density})
    mesh = meshio.read(tmp_path / "skin.vtu")
    assert mesh.points == pytest.approx(positions)
    assert np.array_equal(mesh.cells_dict["triangle"], pattern.triangles)
    assert mesh.point_data["displacement"] == pytest.approx(positions - pattern.points)
    assert mesh.cell_data["density"][0] == pytest.approx(density)
    assert np.array_equal(mesh.cell_data["panel"][0], pattern.panel)


def test_a_field_file_is_whole_or_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pattern, path = square(n=2), tmp_path / "skin.vtu"
    write_fields(path, pattern, pattern.points, {})
    before = path.read_bytes()

    def cut_off(_: object, place: Path, **__: str) -> None:
        place.write_bytes(before[:100])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(meshio.Mesh, "write", cut_off)
    with pytest.raises(OutputError, match=r"skin\.vtu could not be written: .*No space left"):
        write_fields(path, pattern, pattern.points, {})
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["skin.vtu"]


def test_pictures_are_whole_or_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that cannot be drawn or written leaves what was there."""
    path = tmp_path / "a.png"
    with page(path, "A title"):
        pass
    before = path.read_bytes()

    def stopped() -> None:
        with page(path, "Another"):
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        stopped()
    monkeypatch.setattr(
        Path, "replace", lambda self, to: (_ for _ in ()).throw(OSError(28, "full"))
    )
    with pytest.raises(OSError, match="full"), page(path, "Another"):
        pass
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_no_pictures_without_matplotlib(capsys: pytest.CaptureFixture[str]) -> None:
    def lacking() -> None:
        raise ImportError("No module named 'matplotlib'")

    if_plotting(lacking)
    said = "no pictures: No module named 'matplotlib'; in the checkout: pip install '.[plot]'"
    assert said in capsys.readouterr().err


def test_versions() -> None:
    found = versions()
    always = {"toros_fem", "dolfinx", "petsc4py", "numpy", "python", "platform"}
    assert always <= set(found) <= always | {"gmsh", "blas_kernel"}
    assert all(isinstance(version, str) and version for version in found.values())
