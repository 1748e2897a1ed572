"""`toros force` on a small design."""

import csv
import json
import shutil
from pathlib import Path

import pytest
from mpi4py import MPI

from toros_fem.cli.commands.main import run

Designed = tuple[Path, Path]


@pytest.mark.slow
def test_figures_table_and_picture(
    alone: MPI.Comm, designed: Designed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, output = tmp_path / "copy", tmp_path / "force"
    shutil.copytree(designed[1], folder)
    capsys.readouterr()
    few = ["--steps", "2", "--output", str(output), "--json"]
    assert run(alone, ["force", str(folder), *few]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["panel"] == "tip"
    assert len(found["stiffness_n_m_rad"]) == 2
    with (output / "force.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    # At rest at both pressures, where it was at the first at both, and at the second at one.
    assert [(row["held_where_free_at_pa"] == "0.0") for row in rows] == [True] * 2 + [False] * 3
    assert float(rows[1]["force_n"]) == found["pushes"][1]["force_n"]
    assert all(float(row["force_half_width_n"]) >= 0 for row in rows)
    assert (output / "force.png").exists()
    assert run(alone, ["force", str(folder), "--panel", "toe"]) == 2
    assert "Name the free end: --panel" in capsys.readouterr().err
    assert run(alone, ["force", str(folder), "--direction", "1 0"]) == 2
    assert "must be three numbers" in capsys.readouterr().err
