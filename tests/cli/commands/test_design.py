"""`toros design`, `resume`, `view` and `simulate` on one small design."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.command_runs import changes
from helpers.scenes import ROOT, square
from kit.scene_runs import summary_of, value_of
from mpi4py import MPI

from toros_fem.cli.command import Answer
from toros_fem.cli.commands.main import run
from toros_fem.cli.scene_files import read_scene, scene_text
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes.files import write_pattern
from toros_fem.meshes.skin import sew
from toros_fem.products.kinds import KINDS
from toros_fem.results.runs.open_run import open_run

Designed = tuple[Path, Path]


@pytest.mark.slow
def test_json_is_the_summary(
    alone: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The effective scene in the run's folder gives the same design again."""
    _, folder = designed
    output = tmp_path / "again"
    capsys.readouterr()
    words = ["design", str(folder / "scene.toml"), "--output", str(output), "--json"]
    assert run(alone, words) == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert found["command"] == "design"
    assert found["figures"] == summary_of(folder)["figures"] == summary_of(output)["figures"]


@pytest.mark.slow
def test_simulation_of_a_design(
    alone: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, folder = designed
    found = {}
    sources = {"plain": None, "print": folder, "files": folder / "manufacture"}
    for name, source in sources.items():
        more = [] if source is None else ["--pattern", str(source)]
        output = tmp_path / name
        capsys.readouterr()
        at = f"{summary_of(folder)['pressures_pa'][0]} Pa"
        words = ["simulate", str(scene), "--output", str(output), *changes(pressure=at), *more]
        words.append("--json")
        assert run(alone, words) == 0
        captured = capsys.readouterr()
        found[name] = json.loads(captured.out) if alone.rank == 0 else {}
        assert (output / "curve.csv").is_file()
        text = (output / "scene.toml").read_text(encoding="utf-8")
        assert '# fabric = "jersey-light": light jersey' in text
        assert '\nfabric_young = "100 kPa"\n' in text
    assert abs(value_of(found["plain"], "angle_deg") or 0.0) < 0.5
    expected = value_of(summary_of(folder), "angle_deg")
    assert value_of(found["print"], "angle_deg") == pytest.approx(expected, abs=0.05)
    assert value_of(found["files"], "angle_deg") == value_of(found["print"], "angle_deg")


@pytest.mark.slow
def test_what_is_refused_leaves_a_good_run_as_it_was(
    alone: MPI.Comm,
    designed: Designed,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a wrong pattern, the run's own, other values, or another command; also to overwrite it."""
    monkeypatch.setattr("toros_fem.meshes.triangles.MOST_TRIANGLES", 10_000)
    finer = ["--set", "estimate_error=true", "--set", "check_refinement=8"]
    scene, good = designed
    folder = tmp_path / "run"
    shutil.copytree(good, folder)
    (folder / "print_9.stl").write_text("mine")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    simulate = ["simulate", str(scene), "--output", str(folder), *changes()]
    design, again = ["design", *simulate[1:]], [*simulate, "--overwrite"]
    for words, code in (
        ([*simulate, "--pattern", str(scene)], 4),
        (design, 4),
        ([*again, "--pattern", str(folder)], 2),
        ([*again, "--pattern", str(folder / "pattern.npz")], 2),
        ([*design, "--overwrite", "--set", "edge_length=5e-5"], 2),
        ([*design, "--overwrite", "--set", "edge_length=0.4"], 2),
        (["unwrap", str(ROOT / "demos" / "surfaces" / "finger.stl"), "--output", str(folder)], 4),
        (["export", str(folder), "--output", str(folder)], 2),
        (["resume", str(folder)], 4),
        (["resume", str(folder), "--set", "angle=50"], 2),
        (["resume", str(folder), "--set", "curve_steps=0"], 2),
        (["resume", str(folder), *finer], 2),
    ):
        capsys.readouterr()
        assert run(alone, words) == code, words
        told = capsys.readouterr().err
        own = words[-1] in (str(folder), str(folder / "pattern.npz")) and "--pattern" in words
        assert ("belongs to the run in" in told) == own, told
    after = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert after == before


@pytest.mark.parametrize(
    ("kind", "words", "message"),
    [
        ("bend", ["--pattern", "notes.txt"], "notes.txt cannot be read"),
        ("bend", ["--pattern", "square.npz"], "square.npz is the pattern of another skin"),
        ("bend", ["--set", "edge_length=5e-5"], "edge_length"),
        ("inflate", ["--set", "edge_length=5e-5"], "edge_length"),
    ],
)
def test_a_simulation_is_refused_before_it_removes_a_run(
    alone: MPI.Comm,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    words: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("mine")
    other = square()
    write_pattern("square.npz", other, np.ones(len(other.panel), dtype=bool))
    assert run(alone, ["new", kind, "scene.toml"]) == 0
    with open_run(alone, "run", {"command": "simulate"}, scene="earlier"):
        Path("run/curve.csv").write_text("earlier")
    before = {path: path.read_bytes() for path in Path("run").rglob("*") if path.is_file()}
    assert {Path("run/curve.csv"), Path("run/state/run.json")} <= set(before)
    capsys.readouterr()
    assert run(alone, ["simulate", "scene.toml", "--output", "run", "--overwrite", *words]) == 2
    assert message in capsys.readouterr().err
    after = {path: path.read_bytes() for path in Path("run").rglob("*") if path.is_file()}
    assert after == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("design", "inflate"), "scenes of the kind 'inflate' have no design"),
        (("simulate", "tile"), "scenes of the kind 'tile' have no simulate"),
        (("simulate", "inflate", "--pattern", "x"), "'inflate' take no --pattern"),
    ],
)
def test_kinds_without_an_action(
    alone: MPI.Comm,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    message: str,
) -> None:
    command, kind, *rest = words
    path = tmp_path / "scene.toml"
    assert run(alone, ["new", kind, str(path)]) == 0
    capsys.readouterr()
    assert run(alone, [command, str(path), "--output", str(path.parent / "run"), *rest]) == 2
    assert message in capsys.readouterr().err
    assert not (path.parent / "run").exists()


def test_a_mesh_that_has_gone_is_told(
    alone: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By file and key, and not as other inputs than those given."""
    files = {"mesh": tmp_path / "gone.stl"}
    text = scene_text(KINDS["own-mesh"].example(), files)
    with open_run(alone, tmp_path / "run", {"command": "design"}, scene=text):
        pass
    record = tmp_path / "run" / "state" / "run.json"
    record.write_text(record.read_text("utf-8").replace('"finished": true', '"finished": false'))
    assert run(alone, ["resume", str(tmp_path / "run")]) == 2
    assert f"files.mesh: there is no {files['mesh']}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "folder"),
    [
        (("design",), "mine"),
        (("simulate",), "mine-simulated"),
        (("design", "--output", "other"), "other"),
    ],
)
def test_the_folder_is_named_after_the_scene(
    alone: MPI.Comm,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    folder: str,
) -> None:
    """In the folder where the command is run."""
    taken = []

    def record(comm: MPI.Comm, scene: object, name: str, place: Path, **_: object) -> Answer:
        taken.append((name, place))
        return Answer("")

    monkeypatch.setattr("toros_fem.cli.running.run_scene", record)
    file = tmp_path / "mine.toml"
    assert run(alone, ["new", "bend", str(file)]) == 0
    assert run(alone, [words[0], str(file), *words[1:]]) == 0
    assert taken == [(words[0], Path(folder))]


@pytest.mark.slow
def test_a_drawing_is_simulated_as_its_polygons(
    alone: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a template of the scene; and in Python the same print tells the same."""
    pytest.importorskip("svgpathtools")
    scene, drawing, output = designed[0], tmp_path / "stripes.svg", tmp_path / "stripes"
    words = changes(curve_pressure="none", pressure="3 kPa")
    assert run(alone, ["check", str(scene), "--drawing", str(drawing), *words]) == 0
    assert run(alone, ["check", str(scene), "--drawing", str(drawing), *words]) == 2
    assert "is there already, and stays" in capsys.readouterr().err
    text = drawing.read_text(encoding="utf-8")
    stripe = '<rect x="4" y="20" width="70" height="5"/>'
    drawing.write_text(text.replace('<g id="wall">', f'<g id="wall">{stripe}'), encoding="utf-8")
    drawn = ["simulate", str(scene), "--drawing", str(drawing), "--output", str(output), *words]
    assert run(alone, drawn) == 0
    summary = json.loads((output / "summary.json").read_text(encoding="utf-8"))
    assert all(figure["target"] is None for figure in summary["figures"])
    assert run(alone, [*drawn[: -len(words)], "--pattern", str(designed[1]), "--overwrite"]) == 2

    config: Any = read_scene(scene, comm=alone).config.updated(
        **{key: 0.06 if key == "length" else 5e-3 for key in ("length", "edge_length")},
        pressure=3e3,
    )
    case = config.case(alone, config.finest_level)
    pattern = case.pattern
    regions = []
    for panel, name in enumerate(pattern.panel_names):
        outline = pattern.outline(panel)
        left, _, right, high = outline.bounds
        # The template has 5 mm above its panels.
        own = shapely.box(left, high - 0.02, right, high - 0.015) if name == "wall" else outline
        regions.append(own & outline)
    drawn_case = case.following(alone, regions)
    skin = sew(alone, drawn_case.pattern)
    solver = EquilibriumSolver(
        skin, drawn_case.composite, drawn_case.supports, quadratic=drawn_case.quadratic
    )
    found = solver.solve(drawn_case.passive[skin.owned_cells], 3e3)
    positions = skin.gather_vertices(found.positions)
    values = {m.key: m.value(skin.pattern, positions) for m in drawn_case.judged}
    told = value_of(summary, "length_ratio")
    assert told == pytest.approx(values["length_ratio"], rel=1e-3)
