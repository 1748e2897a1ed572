"""Files of a tile design."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.tiles import SMALL, small_result
from mpi4py import MPI

from toros_fem.base.errors import OutputError
from toros_fem.products.tiles.problem import PrintMeasurement
from toros_fem.products.tiles.report import TileRun, read_tile, write_tile_results
from toros_fem.products.tiles.stiffness_profile import Contrast

pytestmark = pytest.mark.usefixtures("without_pictures")


@pytest.mark.slow
def test_files(alone: MPI.Comm, tmp_path: Path) -> None:
    folder = tmp_path / "tile"
    _, result = small_result()
    trial = {"start": "lines", "objective": 0.5, "islands": 2, "narrow": 3}
    result = replace(result, trials=[trial], deviations=(0.25, np.inf))
    measured = PrintMeasurement(
        result.profile, (result.profile,), 200.0, np.ones(4, dtype=bool), {}
    )
    write_tile_results(folder, TileRun(result, measured, {}))
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written["inputs"] == SMALL.as_dict()
    assert written["target"]["stiffness_n_per_m"] == [2000, 1000, 500, 400]
    assert written["target"]["contraction"] is None
    deviations = result.profile.stiffness / [2000, 1000, 500, 400] - 1
    assert written["worst_percent"] == pytest.approx(100 * np.abs(deviations).max())
    assert written["trials"] == [trial]
    assert (written["blank_n_per_m"], written["buckling"]) == (200.0, 4 * [True])
    assert written["manufacture"] == result.printability.summary()
    assert written["corrections_percent"] == [25.0, None]
    for name in ("profile.csv", "curves.csv"):
        with (folder / name).open(encoding="utf-8") as file:
            found = [float(row["stiffness_n_per_m"]) for row in csv.DictReader(file)]
        assert found == pytest.approx(written["printed"]["stiffness_n_per_m"], rel=1e-12)
    manifest = json.loads((folder / "manufacture" / "manufacture.json").read_text("utf-8"))
    area = 25e6 * result.region.area  # mm²
    assert manifest["print"]["print_area_mm2"] == pytest.approx(area, rel=1e-6)
    made = read_tile(alone, folder)
    assert made.region.equals(result.region)
    assert (made.size, made.edge_length) == ((0.01, 0.01), 0.8e-3)
    assert np.array_equal(made.tile(alone)[1], result.cells), "its mesh is that of the result"
    assert manifest["options"]["layer_height"] == made.composite.reinforcement.thickness
    assert manifest["seams"] == []


def test_a_run_that_looks_finished_has_all_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The summary comes last."""

    def full(*_: object) -> None:
        raise OSError("no space")

    _, result = small_result()
    measured = PrintMeasurement(
        result.profile, (result.profile,), 200.0, np.ones(4, dtype=bool), {}
    )
    monkeypatch.setattr("toros_fem.products.tiles.report.write_tile", full)
    with pytest.raises(OutputError, match="no space"):
        write_tile_results(tmp_path, TileRun(result, measured, {}))
    assert not (tmp_path / "summary.json").exists()


def test_failed_print(tmp_path: Path) -> None:
    """Without an equilibrium of the print, and without a target, the summary has None."""
    folder = tmp_path / "failed"
    case, result = small_result()
    some = np.array([True, False, False, False])
    case = replace(case, objective=Contrast(~some, some))
    result = replace(result, case=case, profile=None, failure="made to fail")
    found = TileRun(result, None, {})
    write_tile_results(folder, found)
    summary = found.entries()
    for key in ("printed", "objective_printed", "worst_percent", "target", "blank_n_per_m",
                "buckling"):  # fmt: skip
        assert summary[key] is None
    assert {figure.value for figure in found.figures} == {None}
    assert summary["printed_failure"] == "made to fail"
    assert summary["objective_designed"] > 0
    assert summary["trials"] == summary["corrections_percent"] == []
    assert not (folder / "profile.csv").exists()
    assert (folder / "pattern.svg").exists()
