"""A folder for files, the same on all ranks."""

from pathlib import Path

import pytest
from mpi4py import MPI


@pytest.fixture
def folder(comm: MPI.Comm, tmp_path: Path) -> Path:
    return Path(comm.bcast(tmp_path, root=0))
