"""`toros check`: errors with their line, and the cost of a design."""

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.command_runs import changes, small_scene
from helpers.designs import case_of
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files import read_scene
from toros_fem.mechanics.readings.bare_tube import tube_pressure, tube_strains


def test_cost_of_a_design(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = small_scene(alone, tmp_path)
    capsys.readouterr()
    assert run(alone, ["check", str(scene), *changes(estimate_error="true"), "--json"]) == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert found["kind"] == "bend"
    assert found["inputs"]["angle"] == 45.0
    assert found["largest"] == found["triangles"]
    assert 0.2 < found["memory_gib"] < 1


def test_triangles_and_unknowns_are_those_of_the_mesh(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    comm = MPI.COMM_SELF
    scene = small_scene(comm, tmp_path)
    capsys.readouterr()
    words = changes(edge_length="2.5 mm")
    assert run(comm, ["check", str(scene), *words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    made = case_of(comm, read_scene(scene, changes=words[1::2]).config)  # type: ignore[arg-type]
    assert found["triangles"] == pytest.approx(len(made.pattern.panel), rel=0.1)
    count = 3 * len(made.pattern.points) + len(made.pattern.edges.ends)
    assert found["unknowns"] == pytest.approx(count, rel=0.12)


@pytest.mark.parametrize(("length", "fits"), [("170 mm", True), ("200 mm", False)])
def test_a_panel_too_large_for_the_bed_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], length: str, fits: bool
) -> None:
    scene = small_scene(MPI.COMM_SELF, tmp_path)
    capsys.readouterr()
    words = ["check", str(scene), *changes(length=length, edge_length="6 mm")]
    assert run(MPI.COMM_SELF, words) == 0
    text = capsys.readouterr().out
    assert ("\nbed " in text) is not fits
    if not fits:
        assert "--bed-depth" in text
        assert "panel 'wall'" in text
    assert run(MPI.COMM_SELF, [*words, "--json"]) == 0
    assert (json.loads(capsys.readouterr().out)["placing"] is None) is fits


def test_lines_of_a_reader(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = small_scene(MPI.COMM_SELF, tmp_path)
    capsys.readouterr()
    words = ["check", str(scene), *changes(reinforcement="tpu-85a", edge_length="4 mm"), "--quiet"]
    assert run(MPI.COMM_SELF, words) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"{scene} is in order: a tube that bends.\nfabric         jersey-light")
    assert "\nreinforcement  tpu-85a: TPU" in text
    assert "\ntriangles   about " in text


@pytest.mark.parametrize(
    "words",
    [
        ("edge_length=1e-6",),
        ("edge_length=1e-6", "levels=1"),
        ("start=relaxed", "print_edge_length=1e-6"),
    ],
    ids=" ".join,
)
def test_too_large_meshes_are_refused(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    scene = small_scene(alone, tmp_path)
    radius = "filter_radius=1.5e-6"
    options = [part for word in (*words, radius) for part in ("--set", word)]
    for command in (["check"], ["design", "--output", str(scene.parent / "run")]):
        capsys.readouterr()
        assert run(alone, [*command, str(scene), *options]) == 2
        error = capsys.readouterr().err
        key = "print_edge_length" if "start=relaxed" in words else "edge_length"
        assert f"FileError: {scene}: {key} = " in error
    capsys.readouterr()
    assert run(alone, ["check", str(scene), *options, "--allow-large"]) == 0


def test_wrong_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text('kind = "bend"\n\n[pressure]\npressur = "5 kPa"\n', encoding="utf-8")
    assert run(MPI.COMM_SELF, ["check", str(path), "--json"]) == 2
    found = json.loads(capsys.readouterr().out)["error"]
    assert "did you mean 'pressure'" in found["message"]
    assert (found["type"], found["key"]) == ("FileError", "pressure.pressur")
    assert (found["file"], found["line"]) == (str(path), 4)


def test_a_mesh_that_is_not_there(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "own.toml"
    assert run(alone, ["new", "own-mesh", str(path)]) == 0
    capsys.readouterr()
    assert run(alone, ["check", str(path)]) == 2
    assert "files.mesh: there is no" in capsys.readouterr().err


def test_own_mesh(alone: MPI.Comm, capsys: pytest.CaptureFixture[str]) -> None:
    scene = ROOT / "examples" / "finger.toml"
    assert run(alone, ["check", str(scene), "--coarse", "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["triangles"] == 1832


@pytest.mark.parametrize(("kind", "triangles"), [("inflate", 715), ("tile", 10000)])
def test_other_kinds(
    alone: MPI.Comm,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    triangles: int,
) -> None:
    path = tmp_path / "scene.toml"
    assert run(alone, ["new", kind, str(path)]) == 0
    capsys.readouterr()
    assert run(alone, ["check", str(path), "--coarse", "--json"]) == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert found["triangles"] == pytest.approx(triangles, rel=0.1)


def test_what_the_pressure_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """To the bare fabric, and which one the target wants."""
    scene = small_scene(MPI.COMM_SELF, tmp_path)
    capsys.readouterr()
    words = ["check", str(scene), *changes(pressure="8 kPa")]
    assert run(MPI.COMM_SELF, words) == 0
    (line,) = [x for x in capsys.readouterr().out.splitlines() if x.startswith("pressure ")]
    config: Any = read_scene(scene, changes=changes(pressure="8 kPa")[1::2]).config
    radius, sheet = config.radius, config.material.composite
    around, along = tube_strains(sheet, radius, 8e3)
    assert f"8 kPa makes the bare skin {around:.0%} wider and {along:.0%} longer" in line
    needed = tube_pressure(sheet, radius, config.needed_strain)
    assert (
        f"needs {config.needed_strain:.0%}; the bare skin has that from {needed / 1e3:.2g} kPa on"
        in line
    )
