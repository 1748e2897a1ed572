"""`toros design`, `resume`, `view` and `simulate` on one small design."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers.command_runs import changes, small_scene
from helpers.scenes import ROOT, shared
from mpi4py import MPI

from toros_fem.cli.commands.main import run

Designed = tuple[Path, Path]


def summary_of(folder: Path) -> dict:
    return dict(json.loads((folder / "summary.json").read_text(encoding="utf-8")))


@pytest.mark.slow
def test_design_leaves_its_files_and_its_scene(designed: Designed) -> None:
    _, folder = designed
    names = {path.name for path in folder.iterdir()}
    assert {"summary.json", "history.csv", "pattern.svg", "print.npz", "scene.toml"} <= names
    assert (folder / "manufacture" / "make_it.html").is_file()
    inputs = summary_of(folder)["inputs"]
    assert inputs["angle"] == 45.0
    assert inputs["filter_radius"] == 8e-3


@pytest.mark.slow
def test_json_is_the_summary(
    comm: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The effective scene in the run's folder gives the same design again."""
    _, folder = designed
    output = shared(comm, tmp_path) / "again"
    capsys.readouterr()
    words = ["design", str(folder / "scene.toml"), "--output", str(output), "--json"]
    assert run(comm, words) == 0
    captured = capsys.readouterr()
    if comm.rank == 0:
        found = json.loads(captured.out)
        assert found["command"] == "design"
        assert (
            found["angle_deg"] == summary_of(folder)["angle_deg"] == summary_of(output)["angle_deg"]
        )


@pytest.mark.slow
def test_a_finished_run_is_not_resumed(
    comm: MPI.Comm, designed: Designed, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(comm, ["resume", str(designed[1])]) == 4
    assert ("there is nothing to resume" in capsys.readouterr().err) == (comm.rank == 0)


def test_no_run_to_resume(
    comm: MPI.Comm, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(comm, ["resume", str(tmp_path)]) == 4
    assert ("holds no run" in capsys.readouterr().err) == (comm.rank == 0)


@pytest.mark.slow
def test_view(comm: MPI.Comm, designed: Designed, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert run(comm, ["view", str(designed[1]), "--json"]) == 0
    captured = capsys.readouterr()
    if comm.rank == 0:
        page = Path(json.loads(captured.out)["report"])
        assert page == designed[1] / "report.html"
        assert "</html>" in page.read_text(encoding="utf-8")
    assert run(comm, ["view", str(designed[0].parent / "nowhere")]) == 4


@pytest.mark.slow
def test_simulation_of_a_design(
    comm: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, folder = designed
    found = {}
    named = ["--set", "fabric=jersey-light"]
    for name, more in (("plain", named), ("print", ["--pattern", str(folder)])):
        output = shared(comm, tmp_path) / name
        capsys.readouterr()
        words = ["simulate", str(scene), "--output", str(output), *changes(), *more, "--json"]
        assert run(comm, words) == 0
        captured = capsys.readouterr()
        found[name] = json.loads(captured.out) if comm.rank == 0 else {}
        assert (output / "curve.csv").is_file()
        text = (output / "scene.toml").read_text(encoding="utf-8")
        assert ('# fabric = "jersey-light": light jersey' in text) == (name == "plain")
        assert '\nfabric_young = "100 kPa"\n' in text
    if comm.rank == 0:
        assert abs(found["plain"]["angle_deg"]) < 0.5
        expected = summary_of(folder)["angle_deg"]
        assert found["print"]["angle_deg"] == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("design", "inflate"), "scenes of the kind 'inflate' have no design"),
        (("simulate", "tile"), "scenes of the kind 'tile' have no simulate"),
        (("simulate", "inflate", "--pattern", "x"), "'inflate' take no --pattern"),
    ],
)
def test_kinds_without_an_action(
    comm: MPI.Comm,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    message: str,
) -> None:
    command, kind, *rest = words
    path = shared(comm, tmp_path) / "scene.toml"
    assert run(comm, ["new", kind, str(path)]) == 0
    capsys.readouterr()
    assert run(comm, [command, str(path), "--output", str(path.parent / "run"), *rest]) == 2
    assert (message in capsys.readouterr().err) == (comm.rank == 0)
    assert not (path.parent / "run").exists()


@pytest.mark.slow
def test_stopped_and_resumed_on_other_ranks(tmp_path: Path) -> None:
    """SIGTERM ends a real run with its code and one line; two ranks go on with it."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX"))}
    environment |= {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    scene, folder = small_scene(MPI.COMM_SELF, tmp_path), tmp_path / "run"
    toros = [sys.executable, "-m", "toros_fem"]
    words = ["design", str(scene), "--output", str(folder), *changes(iterations="8")]
    process = subprocess.Popen(
        [*toros, *words], env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    history, deadline = folder / "history.csv", time.monotonic() + 120
    while time.monotonic() < deadline and process.poll() is None:
        if history.exists() and len(history.read_text().splitlines()) > 2:
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, error = process.communicate(timeout=120)
    assert process.returncode == 143, error
    assert "Traceback" not in error
    assert f"toros resume {folder}" in error
    assert not (folder / "summary.json").exists()
    known = history.read_text().splitlines()
    ranks = ["mpirun", "--oversubscribe", "-n", "2"]
    done = subprocess.run(
        [*ranks, *toros, "resume", str(folder), "--json"], env=environment, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["inputs"]["iterations"] == 8
    assert found["ranks"] == 2
    assert len(history.read_text().splitlines()) > len(known)
