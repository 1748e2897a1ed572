"""The demos run, leave what they promise, and refuse bad input alike on all ranks."""

import csv
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import asdict
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

from demos import bend as demo
from demos import three_field
from toros_fem import errors
from toros_fem.actuators import case as scene
from toros_fem.actuators.case import ActuatorConfig
from toros_fem.command_line import last_line
from toros_fem.design.shape_problem import ShapeProblem
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumSolver
from toros_fem.meshes import Skin

SMALL: dict[str, Any] = {
    "length": 0.08,
    "edge_length": 4.5e-3,
    "radius": 7e-3,
    "angle": 45.0,
    "iterations": 8,
    "constrained": 6,
    "refine": 1,
}


@pytest.fixture(scope="module")
def output(comm: MPI.Comm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bend") if comm.rank == 0 else None
    folder = comm.bcast(folder, root=0)
    assert folder is not None
    demo.run(comm, folder, **SMALL)
    comm.barrier()
    return folder


def read(folder: Path, name: str = "summary.json") -> dict[str, Any]:
    return dict(json.loads((folder / name).read_text(encoding="utf-8")))


def test_summary(comm: MPI.Comm, output: Path) -> None:
    summary = read(output)
    assert summary["objective_last"] < summary["objective_first"] / 10
    assert 22 < summary["design"]["angle_deg"] < 60, "well on its way after a few steps"
    assert summary["angle_target_deg"] == 45
    change = abs(summary["angle_refined_deg"] - summary["angle_deg"])
    assert summary["angle_error_deg"] == pytest.approx(3 * change)
    assert 0 < change < 10
    assert 1e3 <= summary["pressure_pa"] <= 2e4
    assert summary["pressure_pa"] != 5e3, "the pressure is designed"
    assert summary["iterations"] == 14
    assert summary["ranks"] == comm.size
    assert summary["seed"] == 2
    assert summary["gradient_norm_first"] > 0
    assert 0 < summary["volume_fraction"] < 1
    assert 0 <= summary["grey_level"] <= 1
    assert summary["newton_steps"] > 8
    assert set(summary["seconds"]) >= {"filter", "equilibrium", "adjoint", "mma", "total"}
    assert summary["inputs"] == {**asdict(ActuatorConfig()), **demo.DEFAULTS, **SMALL}
    assert {"dolfinx", "toros_fem", "petsc4py"} <= set(summary["versions"])


def test_summary_of_what_is_printed(output: Path) -> None:
    """Figures of the binary pattern, simulated again, beside the optimiser's own."""
    summary = read(output)
    assert summary["printed_failure"] is None
    assert summary["angle_deg"] != summary["design"]["angle_deg"]
    assert summary["printed_objective"] > 0
    assert set(summary["length_scale"]) >= {"g_r", "g_t", "epsilon_r", "epsilon_t", "satisfied"}
    made = summary["manufacture"]
    assert made["pieces"] >= 3, "the wall's and the two caps"
    assert made["smallest_width_mm"] > 0
    assert made["border_mm"] > 0
    dropped = summary["dropped"]
    assert dropped["before"]["islands"] - dropped["islands"] == made["islands"]


def test_history(output: Path) -> None:
    with (output / "history.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["iteration"]) for row in rows] == [*range(9), *range(8, 15)]
    assert [int(row["stage"]) for row in rows] == [0] * 9 + [1] * 7
    assert float(rows[-1]["angle_deg"]) > float(rows[0]["angle_deg"])
    assert float(rows[-1]["solid"]) < 0.5 * float(rows[8]["solid"]), "constraints act"


def test_fields(output: Path) -> None:
    mesh = meshio.read(output / "skin.vtu")
    summary = read(output)
    assert len(mesh.cells_dict["triangle"]) == summary["triangles"]
    for name in ("rho", "rho_filtered", "rho_projected", "printed"):
        values = mesh.cell_data[name][0]
        assert values.min() >= -1e-12
        assert values.max() <= 1 + 1e-12
    assert set(np.unique(mesh.cell_data["printed"][0])) == {0.0, 1.0}
    a, b, c = np.moveaxis(mesh.points[mesh.cells_dict["triangle"]], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(summary["volume_m3"], rel=1e-6)


def test_svg_is_true_to_scale(output: Path) -> None:
    root = ET.parse(output / "pattern.svg").getroot()
    space = "{http://www.w3.org/2000/svg}"
    section_vertices = {group.get("id"): group for group in root.iter(space + "g")}
    assert set(section_vertices) == {"wall", "base", "tip"}
    cut = next(p for p in section_vertices["wall"].iter(space + "path") if p.get("class") == "cut")
    numbers = cut.get("d", "").replace("M", " ").replace("L", " ").replace("Z", " ")
    points = np.array([[float(v) for v in pair.split(",")] for pair in numbers.split()])
    sides = round(np.pi * 0.02 / 4.5e-3)
    width = sides * 20 * np.sin(np.pi / sides)
    assert np.ptp(points, axis=0) == pytest.approx([width, 80.0], abs=2e-3)
    box = [float(v) for v in root.get("viewBox", "").split()]
    assert root.get("width") == f"{box[2]:.3f}mm"
    # The caps are reinforced all over: print and cut cover the same.
    paths = {p.get("class"): p.get("d") for p in section_vertices["tip"].iter(space + "path")}
    assert set(paths) == {"cut", "print"}


def test_pictures(output: Path) -> None:
    for name in ("pattern.png", "manufacture.png", "shape.png", "convergence.png"):
        assert (output / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"pressure": -1.0}, errors.ParameterError, "pressure = -1"),
        (
            {"pressure": -1.0, "pressure_min": 0.0, "pressure_max": 0.0},
            errors.ParameterError,
            "pressure = -1.0 Pa",
        ),
        ({"diameter": float("nan")}, errors.ParameterError, "diameter = nan"),
        ({"c1": 0.9}, errors.ParameterError, "c1 = 0.9"),
        ({"fabric_young": 0.0}, errors.ParameterError, "young = 0"),
        ({"mesh": "hexagons"}, errors.ParameterError, "mesh = 'hexagons'"),
        ({"edge_length": 0.5}, errors.ParameterError, "edge_length = 0.5"),
        ({"iterations": 0}, errors.ParameterError, "iterations = 0"),
        ({"pressure": 5e4}, errors.ParameterError, "pressure = 50000"),
        ({"filter": "gauss"}, errors.ParameterError, "filter = 'gauss'"),
        ({"line": 0.1}, errors.ParameterError, "out of control"),
        ({"seed": -1}, errors.ParameterError, "seed = -1"),
        ({"print_width": 0.0}, errors.ParameterError, "print_width = 0"),
        ({"polish": -5}, errors.ParameterError, "polish = -5"),
        ({"island_area": float("nan")}, errors.ParameterError, "island_area = nan"),
        ({"pressure_min": 5e3, "pressure_max": 5e3}, errors.ParameterError, "no room"),
        ({"tip_weight": -9.0}, errors.ParameterError, "tip_weight = -9"),
        ({"presure": 1e4}, errors.ParameterError, "'presure' is no parameter"),
    ],
)
def test_bad_input(
    comm: MPI.Comm,
    tmp_path: Path,
    changes: dict[str, float],
    error: type[Exception],
    message: str,
) -> None:
    with pytest.raises(error, match=message):
        demo.run(comm, tmp_path / "out", **{**SMALL, **changes})


def test_output_that_cannot_be_written(comm: MPI.Comm, tmp_path: Path) -> None:
    """Rank 0 alone writes, yet all ranks raise."""
    tmp_path = comm.bcast(tmp_path, root=0)
    if comm.rank == 0:
        (tmp_path / "taken").write_text("a file, not a folder", encoding="utf-8")
    comm.barrier()
    with pytest.raises(errors.OutputError, match="taken could not be written"):
        demo.run(comm, tmp_path / "taken", **SMALL)


def test_three_field_table_and_strip(comm: MPI.Comm, tmp_path: Path) -> None:
    tmp_path = comm.bcast(tmp_path, root=0)
    inputs = {**SMALL, "edge_length": 6e-3, "radius": 9e-3, "refine": 0, "perimeter": 1e-4}
    inputs |= {"iterations": 2, "constrained": 2}
    rows = three_field.run(comm, tmp_path / "out", **inputs)["rows"]
    comm.barrier()
    assert [row["variant"] for row in rows] == list(three_field.variants({**inputs}))
    written = read(tmp_path / "out", "three_field.json")["rows"]
    for row, line in zip(rows, written, strict=True):  # each rank has a clock of its own
        assert {**row, "seconds": 0.0} == {**line, "seconds": 0.0}
    assert {row["iterations"] for row in rows} == {4}
    by_name = {row["variant"]: row for row in rows}
    assert by_name["filter only"]["grey_level"] > 1.1 * by_name["projection"]["grey_level"]
    assert by_name["perimeter"]["shape_designed"] != by_name["projection"]["shape_designed"]
    assert (tmp_path / "out" / "three_field.png").read_bytes().startswith(b"\x89PNG")


def test_polish_takes_islands_out(
    comm: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a start with a lone spot in a corner that the few steps cannot remove."""
    tmp_path = comm.bcast(tmp_path, root=0)

    def spotted(skin: Skin, seed: int) -> np.ndarray:
        wall = skin.pattern.cells_of("wall")
        u, v = skin.pattern.centroids.T
        width = u[wall].max()
        spot = np.hypot(u - 0.2 * width, v - 0.04) < 6e-3
        return np.where((np.abs(u - width / 2) < 8e-3) | spot, 1.0, 0.0)[skin.owned_cells]

    monkeypatch.setattr(scene, "random_density", spotted)
    inputs = {**SMALL, "iterations": 1, "constrained": 0, "move": 0.01, "refine": 0}
    left = demo.run(comm, tmp_path / "left", **inputs, polish=0, island_area=0.0)
    assert left["manufacture"]["islands"] == 1
    gone = demo.run(comm, tmp_path / "gone", **inputs, polish=2, island_area=0.0)
    assert gone["iterations"] == left["iterations"] + 2
    assert gone["dropped"]["before"]["islands"] == 0
    assert gone["manufacture"]["islands"] == 0


def fails(*_: object) -> None:
    """In place of a simulation."""
    raise EquilibriumError("made to fail", None)  # type: ignore[arg-type]


def test_print_without_equilibrium(
    comm: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing of the design's is passed off as the print's."""
    tmp_path = comm.bcast(tmp_path, root=0)

    monkeypatch.setattr(ShapeProblem, "simulate_binary", fails)
    inputs = {**SMALL, "iterations": 1, "constrained": 0, "polish": 0, "refine": 0}
    summary = demo.run(comm, tmp_path / "out", **inputs)
    assert summary["printed_failure"] == "made to fail"
    assert summary["angle_deg"] is summary["printed_objective"] is summary["volume_m3"] is None
    assert summary["design"]["angle_deg"] is not None
    assert "angle no equilibrium of 45 degrees as printed" in last_line(summary)


def test_a_refined_mesh_without_equilibrium_loses_nothing(
    comm: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path = comm.bcast(tmp_path, root=0)

    monkeypatch.setattr(scene, "estimate_error", fails)
    inputs = {**SMALL, "iterations": 1, "constrained": 0, "polish": 0}
    summary = demo.run(comm, tmp_path / "out", **inputs)
    assert summary["refined"] == "made to fail"
    assert summary["angle_error_deg"] is summary["angle_refined_deg"] is None
    assert summary["angle_deg"] is not None
    assert "±" not in last_line(summary)
    if comm.rank == 0:
        assert (tmp_path / "out" / "pattern.svg").exists()


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX"))}
    return subprocess.run(
        [sys.executable, str(ROOT / "demos" / "bend.py"), *arguments],
        env=environment,
        text=True,
        capture_output=True,
        check=False,
    )


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its own interpreter")
def test_command_line_reaches_the_coarse_figures(tmp_path: Path) -> None:
    """What the coarse bend is held to, in fewer steps on a coarser mesh: 200 times, within 10 %."""
    fewer = ("--iterations", "16", "--constrained", "16")
    coarser = ("--edge-length", "5.5e-3", "--radius", "8.25e-3")
    done = command("--coarse", *fewer, *coarser, "--output", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    summary = read(tmp_path / "out")
    assert 700 < summary["triangles"] < 900
    assert summary["objective_first"] / summary["objective_last"] > 200
    assert summary["angle_deg"] == pytest.approx(180, rel=0.1)
    assert summary["design"]["angle_deg"] == pytest.approx(summary["angle_deg"], abs=10)
    assert summary["grey_level"] < 0.08
    assert summary["length_scale"]["satisfied"]
    made = summary["manufacture"]
    assert made["islands"] == made["narrow_places"] == made["tight_places"] == 0
    assert made["smallest_width_mm"] >= 0.6
    assert summary["iterations"] == 32
    assert f"see {tmp_path / 'out'}/" in done.stdout
    assert done.stdout.count("\n") == 36


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its own interpreter")
def test_command_line_refuses_in_one_line(tmp_path: Path) -> None:
    done = command("--coarse", "--pressure", "-3", "--output", str(tmp_path / "out"))
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "ParameterError: pressure = -3.0 must be a finite number, between 1000 and 20000."
    ]


def test_failure_keeps_what_is_written(
    comm: MPI.Comm, output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A design that nothing holds is refused; files of a run before stay as they are."""
    names = ("summary.json", "history.csv", "pattern.svg")
    before = [(output / name).read_bytes() for name in names]

    def refuses(*_: object, **__: object) -> None:
        raise errors.NoEquilibriumError("made to fail")

    monkeypatch.setattr(EquilibriumSolver, "solve", refuses)
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        demo.run(comm, output, **SMALL)
    comm.barrier()
    assert [(output / name).read_bytes() for name in names] == before
