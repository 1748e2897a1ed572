"""Patterns as files: nothing is lost, and what is no pattern is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base.errors import PatternFileError
from toros_fem.base.mpi import on_first_rank
from toros_fem.meshes import cylinder, read_pattern, write_pattern
from toros_fem.meshes.pattern_file import VERSION


@pytest.fixture
def file(alone: MPI.Comm, tmp_path: Path) -> Path:
    path = tmp_path / "pattern.npz"
    tube = cylinder(alone, 0.06, 0.02, 6e-3, planes=(1,))
    on_first_rank(alone, lambda: write_pattern(path, tube))
    return path


def rewritten(comm: MPI.Comm, path: Path, **changes: Any) -> Path:
    """The file with other entries; those that are None are left out."""

    def write() -> None:
        with np.load(path) as archive:
            entries = {**archive, **changes}
        np.savez(path, **{key: value for key, value in entries.items() if value is not None})

    on_first_rank(comm, write)
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "another"}, "is another kind of file"),
        ({"version": VERSION + 1}, f"has version {VERSION + 1}; this toros_fem reads up to"),
        ({"sewn": None, "moulded": None}, "lacks sewn, moulded"),
        ({"version": "new"}, "is not valid"),
    ],
)
def test_other_files_are_refused(
    alone: MPI.Comm, file: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(PatternFileError, match=message):
        read_pattern(alone, rewritten(alone, file, **changes))


@pytest.mark.parametrize("path", ["abc", "pattern.json"])
def test_another_ending_is_refused(alone: MPI.Comm, tmp_path: Path, path: str) -> None:
    """NumPy would write a file of another name."""
    tube = cylinder(alone, 0.06, 0.02, 6e-3)
    with pytest.raises(PatternFileError, match=r"must end in \.npz"):
        write_pattern(tmp_path / path, tube)
    assert list(tmp_path.iterdir()) == []
