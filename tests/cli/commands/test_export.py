"""`toros export`: the machine files of one small design, and the design read back from them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers.command_runs import changes
from helpers.machine_files import read_regions
from kit.scene_runs import summary_of, value_of
from mpi4py import MPI

from toros_fem.cli.commands.main import run
from toros_fem.making.printability import printed_cells, read_print_polygons
from toros_fem.meshes.files import read_print

Designed = tuple[Path, Path]
# What the files may change of printed area and angle.
BOUND = 0.005


@pytest.mark.slow
def test_export_writes_what_the_design_wrote(
    alone: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, folder = designed
    output = tmp_path / "out"
    capsys.readouterr()
    assert run(alone, ["export", str(folder), "--output", str(output), "--json"]) == 0
    captured = capsys.readouterr()
    assert (output / "pattern.svg").read_bytes() == (folder / "pattern.svg").read_bytes()
    for name in ("cut_1.svg", "print_1.stl", "make_it.html"):
        assert (output / name).read_bytes() == (folder / "manufacture" / name).read_bytes()
    found = json.loads(captured.out)
    assert found["manufacture"] == summary_of(folder)["manufacture"]
    assert all((output / name).is_file() for name in found["files"])
    manifest = json.loads((output / "manufacture.json").read_text(encoding="utf-8"))
    thickness = summary_of(folder)["inputs"]["reinforcement_thickness"]
    assert manifest["options"]["layer_height"] == thickness
    again = ["export", str(folder), "--output", str(output)]
    assert run(alone, again) == 0, "all files of an earlier export may be replaced"
    (output / "manufacture.json").unlink()
    (output / "make_it.html").write_text("mine")
    assert run(alone, again) != 0
    assert "make_it.html" in capsys.readouterr().err
    assert (output / "make_it.html").read_text() == "mine"


@pytest.mark.slow
def test_exported_print_is_the_design(
    alone: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Read from the cut files and laid on the triangles it has the same area and angle."""
    scene, folder = designed
    output, again = (tmp_path / name for name in ("out", "again"))
    words = ["export", str(folder), "--output", str(output), "--grain", "none"]
    assert run(alone, [*words, "--bed-width", "0.12", "--bed-depth", "0.11"]) == 0
    stored = read_print_polygons(alone, folder)
    areas = stored.pattern.areas
    designed_area = areas[printed_cells(stored.pattern, stored.regions)].sum()
    read_back = areas[printed_cells(stored.pattern, read_regions(output, stored.pattern))].sum()
    assert read_back == pytest.approx(designed_area, rel=BOUND)
    source, printed = read_print(alone, output / "pattern.npz")
    assert np.array_equal(source.corners, read_print(alone, folder / "pattern.npz")[0].corners)
    assert 2 * source.areas[printed].sum() == pytest.approx(designed_area, rel=BOUND)
    capsys.readouterr()
    words = ["simulate", str(scene), "--output", str(again), "--pattern", str(output), "--json"]
    at = f"{summary_of(folder)['pressures_pa'][0]} Pa"
    assert run(alone, [*words, *changes(pressure=at)]) == 0
    captured = capsys.readouterr()
    angle = value_of(summary_of(folder), "angle_deg")
    assert value_of(json.loads(captured.out), "angle_deg") == pytest.approx(angle, rel=BOUND)


@pytest.mark.slow
def test_a_height_that_is_not_known_is_told(
    alone: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lone, output = tmp_path / "lone", tmp_path / "out"
    lone.mkdir()
    shutil.copy(designed[1] / "print.npz", lone)
    capsys.readouterr()
    assert run(alone, ["export", str(lone), "--output", str(output)]) == 0
    assert "no summary.json" in capsys.readouterr().err
    words = ["export", str(lone), "--output", str(output), "--layer-height", "0.3 mm"]
    assert run(alone, words) == 0
    assert "no summary.json" not in capsys.readouterr().err
