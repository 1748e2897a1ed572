"""`toros tolerance` on a small design."""

import json
import shutil
from pathlib import Path

import pytest
from helpers.runs import change_summary
from kit.scene_runs import value_of
from mpi4py import MPI

from toros_fem.base.errors import FileError
from toros_fem.cli.commands.main import run
from toros_fem.cli.commands.tolerance import scene_of_run

Designed = tuple[Path, Path]
FEW = ["--modulus", "none", "--thickness", "none"]


@pytest.mark.slow
def test_figures_table_and_picture(
    alone: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside the design, whose page shows them."""
    folder = tmp_path / "copy"
    shutil.copytree(designed[1], folder)
    own = {"angle_deg": 12.0}  # where a finer mesh tells the figure
    change_summary(folder, errors={"meshes": {"1.0": own, "0.5": {"angle_deg": 13.0}}})
    capsys.readouterr()
    assert run(alone, ["tolerance", str(folder), "--json", *FEW]) == 0
    captured = capsys.readouterr()
    assert run(alone, ["view", str(folder)]) == 0
    found = json.loads(captured.out)
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert found["command"] == "tolerance"
    assert found["own_mesh"]["angle_deg"] == own["angle_deg"]
    assert found["own_mesh"]["length_ratio"] == value_of(summary, "length_ratio")
    assert found["pressure_pa"] == value_of(summary, "pressure_pa")
    # All commands simulate a print on the same mesh.
    told = value_of(summary, "angle_deg")
    assert found["nominal"]["angle_deg"] == pytest.approx(told, rel=1e-6)
    assert [row["change"] for row in found["variants"]] == [
        "−0.2 mm", "−0.1 mm", "+0.1 mm", "+0.2 mm", "−5 %", "+5 %",
    ]  # fmt: skip
    less, more = (row["angle_deg_change"] for row in found["variants"][-2:])
    assert less < 0 < more, "a lower pressure bends less"
    assert all((folder / name).is_file() for name in found["files"])
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert found["worst"]["angle_deg"]["sentence"] in page
    assert "print width −0.2 mm" in page


def test_a_run_without_its_scene(alone: MPI.Comm, designed: Designed, tmp_path: Path) -> None:
    """No kind is guessed from the numbers in the summary."""
    folder = tmp_path / "copy"
    shutil.copytree(designed[1], folder)
    (folder / "scene.toml").unlink()
    with pytest.raises(FileError, match=r"copy does not say which scene .* scene.toml is miss"):
        scene_of_run(alone, folder)
