"""Regression test: short coarse runs of the demos give the figures in demos/expected/.

These figures are the code's own, after six steps. They show that nothing moved, on any number of
ranks, and not how good a design becomes; `benchmarks/headline.py` runs the long designs.
"""

import json
from pathlib import Path

import pytest
from demo_runs import DEMOS, value_of, without_curve
from expected import PART, RUNS, demo_name, demo_of, inputs_of
from helpers.scenes import ROOT
from mpi4py import MPI

FOLDER = ROOT / "demos" / "expected"
PICTURES = {
    "inflate": ["curve.png", "shapes.png"],
}


def test_every_demo_under_pressure_has_figures() -> None:
    demos = {path.stem for path in (ROOT / "demos").glob("*.py")}
    assert demos - {"own_design", "three_field", "tile", "tile_sheet", "unwrap"} == set(DEMOS)
    assert {path.stem for path in FOLDER.glob("*.json")} == set(RUNS)
    assert {demo_name(name) for name in RUNS} == set(DEMOS)
    assert {name + PART for name, demo in DEMOS.items() if "whole" in demo.config.as_dict()} == {
        name for name in RUNS if name.endswith(PART)
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", list(RUNS))
def test_short_run_gives_the_same_figures(
    comm: MPI.Comm, tmp_path: Path, name: str, request: pytest.FixtureRequest
) -> None:
    if comm.size > 1:  # the first rank alone draws
        request.getfixturevalue("without_pictures")
    expected = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    assert expected["inputs"] == inputs_of(name)
    folder = comm.bcast(tmp_path, root=0) / name
    demo = demo_of(name)
    config = without_curve(demo.config.updated(**expected["inputs"]))
    summary = demo.run(comm, folder, config)
    for key, figure in expected["figures"].items():
        close = pytest.approx(figure["value"], rel=figure["relative"], abs=figure["absolute"])
        assert value_of(summary, key) == close, key
    comm.barrier()
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written["ranks"] == comm.size
    assert (folder / "skin.vtu").exists()
    pictures = PICTURES.get(demo_name(name), ["shape.png"])
    if not name.startswith("inflate"):
        assert (folder / "pattern.svg").exists()
        pictures = [*pictures, "pattern.png", "convergence.png", "manufacture.png"]
    for picture in pictures if comm.size == 1 else []:
        assert (folder / picture).read_bytes().startswith(b"\x89PNG"), picture
