"""Runs to report of."""

from pathlib import Path

import pytest
from helpers.runs import tube, write_run
from mpi4py import MPI

from toros_fem.meshes import Pattern


@pytest.fixture(scope="session")
def pattern() -> Pattern:
    return tube()


@pytest.fixture
def run(tmp_path: Path, pattern: Pattern) -> Path:
    """A finished run; each rank has its own."""
    return write_run(tmp_path / f"run-{MPI.COMM_WORLD.rank}", pattern)
