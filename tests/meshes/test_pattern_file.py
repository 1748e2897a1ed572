"""Patterns as files: nothing is lost, and what is no pattern is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.errors import PatternFileError
from toros_fem.base.mpi import on_first_rank
from toros_fem.meshes import Pattern, cylinder, moulded, read_pattern, write_pattern
from toros_fem.meshes.pattern_file import ARRAYS, NUMBERS, VERSION


@pytest.fixture
def file(comm: MPI.Comm, tmp_path: Path) -> Path:
    path = shared(comm, tmp_path) / "pattern.npz"
    tube = cylinder(comm, 0.06, 0.02, 6e-3, planes=(1,))
    on_first_rank(comm, lambda: write_pattern(path, tube))
    return path


def same(one: Pattern, other: Pattern) -> bool:
    arrays = (np.array_equal(getattr(one, name), getattr(other, name)) for name in ARRAYS)
    return all(arrays) and all(getattr(one, n) == getattr(other, n) for n in NUMBERS)


def test_round_trip(comm: MPI.Comm, file: Path) -> None:
    assert same(read_pattern(comm, file), cylinder(comm, 0.06, 0.02, 6e-3, planes=(1,)))


def test_names_tolerance_and_moulds_are_kept(comm: MPI.Comm, file: Path) -> None:
    """A skin that is moulded has charts that do not fit together, which must stay legal."""
    points = cylinder(comm, 0.06, 0.02, 6e-3).points * [1.0, 1.1, 1.0]
    skin = moulded(points, cylinder(comm, 0.06, 0.02, 6e-3).triangles)
    on_first_rank(comm, lambda: write_pattern(file, skin))
    assert skin.moulded
    assert same(read_pattern(comm, file), skin)


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
        ({"format": None}, "is another kind of file"),
        ({"version": VERSION + 1}, f"has version {VERSION + 1}; this toros_fem reads up to"),
        ({"sewn": None, "moulded": None}, "lacks sewn, moulded"),
        ({"sewn": np.zeros(3)}, "is not valid"),
        ({"flat_points": np.full((4, 2), np.nan)}, "is not finite"),
        ({"version": "new"}, "is not valid"),
    ],
)
def test_other_files_are_refused(
    comm: MPI.Comm, file: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(PatternFileError, match=message):
        read_pattern(comm, rewritten(comm, file, **changes))


@pytest.mark.parametrize("content", [b"", b"solid finger", b"PK\x03\x04 cut short"])
def test_files_that_are_no_archives(comm: MPI.Comm, file: Path, content: bytes) -> None:
    on_first_rank(comm, lambda: file.write_bytes(content))
    with pytest.raises(PatternFileError, match="cannot be read"):
        read_pattern(comm, file)


def test_missing_file(comm: MPI.Comm, tmp_path: Path) -> None:
    with pytest.raises(PatternFileError, match="none.npz cannot be read"):
        read_pattern(comm, shared(comm, tmp_path) / "none.npz")


@pytest.mark.parametrize("path", ["abc", "pattern.json"])
def test_another_ending_is_refused(comm: MPI.Comm, tmp_path: Path, path: str) -> None:
    """NumPy would write a file of another name."""
    tube = cylinder(comm, 0.06, 0.02, 6e-3)
    with pytest.raises(PatternFileError, match=r"must end in \.npz"):
        write_pattern(tmp_path / path, tube)
    assert list(tmp_path.iterdir()) == []
