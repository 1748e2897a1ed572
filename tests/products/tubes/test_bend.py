"""The bending tube as a function: what cannot be written or held loses nothing."""

from pathlib import Path

import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.products.tubes import bend

SMALL = bend.BendScene.of(length=0.06, edge_length=6e-3, filter_radius=9e-3, iterations=1)


def test_output_that_cannot_be_written(alone: MPI.Comm, tmp_path: Path) -> None:
    """Rank 0 alone writes, yet all ranks raise."""
    (tmp_path / "taken").write_text("a file, not a folder", encoding="utf-8")
    with pytest.raises(errors.OutputError, match="taken cannot be used as the folder of a run"):
        SMALL.run_design(alone, tmp_path / "taken")


def test_a_folder_that_is_not_empty_is_refused(alone: MPI.Comm, tmp_path: Path) -> None:
    """A script that designs says so before it designs; files that are there stay as they are."""
    names = ("summary.json", "history.csv", "pattern.svg")
    for name in names:
        (tmp_path / name).write_text(f"{name} of a run before", encoding="utf-8")
    with pytest.raises(errors.OutputError, match="is not empty"):
        SMALL.run_design(alone, tmp_path)
    for name in names:
        assert (tmp_path / name).read_text(encoding="utf-8") == f"{name} of a run before"
