"""Files of a tile design."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import shared
from helpers.tiles import SMALL, small_result
from mpi4py import MPI

from toros_fem.products.tile_design.as_printed import measure_print
from toros_fem.products.tile_design.case import Trial
from toros_fem.products.tile_design.report import write_tile_results
from toros_fem.products.tiles.objectives import Contrast
from toros_fem.products.tiles.printed_tile import PrintedTile, read_tile


@pytest.mark.slow
def test_files(comm: MPI.Comm, tmp_path: Path) -> None:
    folder = shared(comm, tmp_path) / "tile"
    case, result = small_result()
    result = replace(result, trials=(Trial("lines", 0.5, 2, 3),), deviations=(0.25, np.inf))
    assert result.profile is not None
    measured = measure_print(comm, case, SMALL, result)
    made = PrintedTile(result.printed.cells, (0.01, 0.01), 0.8e-3, symmetry="tetragonal")
    summary = write_tile_results(
        comm, folder, case, result, measured, made, config=SMALL, seconds={"total": 3.0}
    )
    comm.barrier()
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    for key in ("printed", "design", "target", "trials", "inputs", "manufacture", "buckling"):
        assert written[key] == summary[key]
    assert written["ranks"] == comm.size
    assert written["seconds"]["total"] == 3.0
    assert written["inputs"] == SMALL.as_dict()
    assert written["target"]["stiffness_n_per_m"] == [2000, 1000, 500, 400]
    assert written["target"]["contraction"] is None
    deviations = result.profile.stiffness / [2000, 1000, 500, 400] - 1
    assert written["worst_percent"] == pytest.approx(100 * np.abs(deviations).max())
    trial = {"start": "lines", "objective": 0.5, "islands": 2, "narrow": 3}
    assert written["trials"] == [trial]
    assert written["manufacture"] == result.printability.summary()
    assert written["corrections_percent"] == [25.0, None]
    with (folder / "profile.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["angle_deg"]) for row in rows] == pytest.approx(np.arange(0, 46, 7.5))
    printed = written["printed"]["stiffness_n_per_m"]
    assert [float(row["stiffness_n_per_m"]) for row in rows[::2]] == pytest.approx(printed)
    with (folder / "curves.csv").open(encoding="utf-8") as file:
        curves = list(csv.DictReader(file))
    assert len(curves) == 4 * len(printed)
    assert float(curves[-1]["strain"]) == 0.1
    assert float(curves[-1]["stiffness_n_per_m"]) == pytest.approx(printed[-1], rel=1e-12)
    assert (read_tile(comm, folder).printed == result.printed.cells).all()
    for name in ("profile", "pattern", "deformed", "convergence", "curves"):
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "tile.vtu").exists()
    assert (folder / "pattern.svg").exists()
    manifest = json.loads((folder / "manufacture" / "manufacture.json").read_text("utf-8"))
    area = sum(region.area for region in result.printed.regions)
    assert manifest["print"]["print_area_mm2"] == pytest.approx(25 * 1e6 * area, rel=1e-6)
    assert manifest["options"]["layer_height"] == made.composite.reinforcement.thickness
    assert manifest["seams"] == manifest["sewing"] == []


def test_failed_print(comm: MPI.Comm, tmp_path: Path) -> None:
    """Without an equilibrium of the print, and without a target, the summary has None."""
    folder = shared(comm, tmp_path) / "failed"
    case, result = small_result()
    some = np.array([True, False, False, False])
    case = replace(case, objective=Contrast(~some, some))
    result = replace(result, profile=None, failure="made to fail")
    made = PrintedTile(result.printed.cells, (0.01, 0.01), 0.8e-3)
    summary = write_tile_results(comm, folder, case, result, None, made)
    for key in ("printed", "objective_printed", "worst_percent", "target", "blank_n_per_m",
                "buckling", "inputs"):  # fmt: skip
        assert summary[key] is None
    assert summary["printed_failure"] == "made to fail"
    assert summary["objective_designed"] > 0
    assert summary["trials"] == summary["corrections_percent"] == []
    comm.barrier()
    assert not (folder / "profile.csv").exists()
    assert (folder / "pattern.png").exists()
