"""Short coarse runs of all demos reach the figures in demos/expected/, on any number of ranks."""

import importlib
import json
from pathlib import Path

import pytest
from expected import RUNS, inputs_of, value_of
from helpers.scenes import ROOT
from mpi4py import MPI

FOLDER = ROOT / "demos" / "expected"


def test_every_demo_that_simulates_has_figures() -> None:
    demos = {path.stem for path in (ROOT / "demos").glob("*.py")}
    assert demos - {"sample", "three_field", "tile", "unwrap"} == set(RUNS)
    assert {path.stem for path in FOLDER.glob("*.json")} == set(RUNS)


@pytest.mark.parametrize("name", list(RUNS))
def test_demo_reaches_its_figures(comm: MPI.Comm, tmp_path: Path, name: str) -> None:
    expected = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert expected["inputs"] == inputs_of(name)
    folder = comm.bcast(tmp_path, root=0) / name
    summary = importlib.import_module(f"demos.{name}").run(comm, folder, **expected["inputs"])
    for key, figure in expected["figures"].items():
        close = pytest.approx(figure["value"], rel=figure["relative"], abs=figure["absolute"])
        assert value_of(summary, key) == close, key
    comm.barrier()
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written["ranks"] == comm.size
    assert (folder / "skin.vtu").exists()
    pictures = {"inflate": ["curve.png", "shapes.png"], "walker": ["gait.png", "tracks.png"],
                "gripper": ["grasp.png", "finger.png"]}.get(name, ["shape.png"])  # fmt: skip
    if name != "inflate":
        assert (folder / "pattern.svg").exists()
        pictures = [*pictures, "pattern.png", "convergence.png", "manufacture.png"]
    for picture in pictures:
        assert (folder / picture).read_bytes().startswith(b"\x89PNG"), picture
