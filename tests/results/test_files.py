"""Tables, fields and summaries are read back as they were written."""

import csv
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from helpers.scenes import square

from toros_fem.base.versions import versions
from toros_fem.design.loop.options import Iteration
from toros_fem.results.files import HistoryFile, write_fields


def test_fields(tmp_path: Path) -> None:
    pattern = square(n=2)
    positions = pattern.points * [1, 2, 1] + [0, 0, 0.5]
    density = np.linspace(0, 1, len(pattern.triangles)).astype(np.float64)
    write_fields(tmp_path / "skin.vtu", pattern, positions, {"density": density})
    mesh = meshio.read(tmp_path / "skin.vtu")
    assert mesh.points == pytest.approx(positions)
    assert np.array_equal(mesh.cells_dict["triangle"], pattern.triangles)
    assert mesh.point_data["displacement"] == pytest.approx(positions - pattern.points)
    assert mesh.cell_data["density"][0] == pytest.approx(density)
    assert np.array_equal(mesh.cell_data["panel"][0], pattern.panel)


def test_history_columns(tmp_path: Path) -> None:
    """All numbers in full precision, metrics as columns of their own."""
    values: dict[str, Any] = {name: 1 / 3 for name in Iteration.__dataclass_fields__}
    row = Iteration(**{**values, "metrics": {"angle_deg": 1 / 7}})
    file = HistoryFile(tmp_path / "history.csv")
    file.write(row)
    file.write(row)
    with (tmp_path / "history.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 2
    names = [name for name in Iteration.__dataclass_fields__ if name != "metrics"]
    assert list(rows[0]) == [*names, "angle_deg"]
    assert {float(rows[1][name]) for name in names} == {1 / 3}
    assert float(rows[1]["angle_deg"]) == 1 / 7


def test_versions() -> None:
    found = versions()
    always = {"toros_fem", "dolfinx", "petsc4py", "numpy", "python", "platform"}
    assert always <= set(found) <= always | {"gmsh", "blas_kernel"}
    assert all(isinstance(version, str) and version for version in found.values())
